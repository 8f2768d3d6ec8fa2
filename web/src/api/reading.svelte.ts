/** A document of the service on a page: read, kept, and read again. */

import { untrack } from 'svelte';
import { get, problemOf, Refusal } from './client';

export class Reading<T> {
  /** Document read last; kept during the next reading. */
  value = $state.raw<T>();
  /** Version of the document, for a change of it. */
  etag = $state<string | null>(null);
  /** Reason why the last reading failed, in a sentence. */
  problem = $state('');
  /** HTTP status of that failure, or 0. */
  status = $state(0);
  #path: () => string;
  #reading: AbortController | undefined;

  constructor(path: () => string) {
    this.#path = path;
  }

  /**
   * Reads the document now; cancels a reading in progress. An effect that calls this does not
   * depend on the parts of the path: it would read again with every estimate of a robot.
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

  /** Stores the answer to a change. */
  take(value: T, etag: string | null): void {
    this.#reading?.abort();
    this.value = value;
    this.etag = etag;
    this.problem = '';
  }

  /** Reads the document now and every `every_ms`; returns a function that stops it. */
  run(every_ms: number): () => void {
    void this.load();
    const timer = setInterval(() => void this.load(), every_ms);
    return () => {
      clearInterval(timer);
      this.#reading?.abort();
    };
  }
}
