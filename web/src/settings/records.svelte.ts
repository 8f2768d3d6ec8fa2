/** A list that an administrator maintains: read whole, and read again after each change. */

import { list, problemOf } from '../api/client';

const RECORDS_MAX = 5000;

export class Records<T> {
  items = $state.raw<readonly T[]>([]);
  loaded = $state(false);
  problem = $state('');
  #path: string;

  constructor(path: string) {
    this.#path = path;
  }

  async load(): Promise<void> {
    try {
      this.items = await list<T>(this.#path, {}, RECORDS_MAX);
      this.loaded = true;
      this.problem = '';
    } catch (error) {
      this.problem = problemOf(error);
    }
  }
}
