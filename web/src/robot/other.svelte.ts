/** History of another robot or an earlier time, read for the stretch that the charts show. */

import { Refusal } from '../api/client';
import type { ParameterName } from '../api/types';
import { type History, readHistory } from './history.svelte';
import { otherLine, type With, wordOf } from './other';
import type { OtherLine } from './plot';
import { allSeries, EMPTY, type Series } from './series';

export class Other {
  problem = $state('');
  #with = $state.raw<With | null>(null);
  #series = $state.raw(new Map<ParameterName, Series>());
  #bucket_s = 1;
  #reading: AbortController | undefined;

  /** Reads it for the stretch of a history. */
  async load(given: With | null, history: History): Promise<void> {
    this.#reading?.abort();
    const reading = new AbortController();
    this.#reading = reading;
    this.problem = '';
    if (given === null) {
      this.#with = null;
      return;
    }
    const by_s = given.kind === 'earlier' ? given.by_s : 0;
    const [from_s, to_s] = history.extent();
    const id = given.kind === 'robot' ? given.id : history.id;
    try {
      const body = await readHistory(id, [from_s - by_s, to_s - by_s], reading.signal);
      this.#series = allSeries(body);
      this.#bucket_s = body.bucket_s;
      this.#with = given;
    } catch (error) {
      if (reading.signal.aborted) return;
      this.#with = null;
      this.problem = error instanceof Refusal ? error.message : String(error);
    }
  }

  /** Returns its line of one parameter; null without one. */
  line(name: ParameterName): OtherLine | null {
    const given = this.#with;
    if (given === null) return null;
    const by_s = given.kind === 'earlier' ? given.by_s : 0;
    const like = { bucket_s: this.#bucket_s, by_s, word: wordOf(given) };
    return otherLine(this.#series.get(name) ?? EMPTY, name, like);
  }
}
