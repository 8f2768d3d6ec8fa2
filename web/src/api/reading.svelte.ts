/** A document of the service as a page shows it: read, kept, and read again. */

import { untrack } from 'svelte';
import { get, problemOf, Refusal } from './client';

export class Reading<T> {
  /** What was read last; it stays while a later reading fails. */
  value = $state.raw<T>();
  /** Its version, for a change of it. */
  etag = $state<string | null>(null);
  /** Why the last reading failed, in a sentence. */
  problem = $state('');
  /** The HTTP status of that failure, or 0. */
  status = $state(0);
  #path: () => string;
  #reading: AbortController | undefined;

  constructor(path: () => string) {
    this.#path = path;
  }

  /**
   * Reads it now; a reading under way gives way to this one. An effect that calls this does not
   * depend on what the path is made of: it would read again with every estimate of a robot.
   */
  async load(): Promise<void> {
    this.#reading?.abort();
    const reading = new AbortController();
    this.#reading = reading;
    try {
      const { body, etag } = await get<T>(untrack(this.#path), reading.signal);
      if (reading.signal.aborted) return;
      this.value = body;
      this.etag = etag;
      this.problem = '';
      this.status = 0;
    } catch (error) {
      if (reading.signal.aborted) return;
      this.problem = problemOf(error);
      this.status = error instanceof Refusal ? error.status : 0;
    }
  }

  /** Takes what a change has answered. */
  take(value: T, etag: string | null): void {
    this.#reading?.abort();
    this.value = value;
    this.etag = etag;
    this.problem = '';
  }

  /** Reads it now and every `every_ms`; returns how to stop. */
  run(every_ms: number): () => void {
    void this.load();
    const timer = setInterval(() => void this.load(), every_ms);
    return () => {
      clearInterval(timer);
      this.#reading?.abort();
    };
  }
}
