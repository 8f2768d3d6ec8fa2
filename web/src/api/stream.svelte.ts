/**
 * The service's event stream, kept open on the topics that the page shows.
 *
 * A browser reopens an event stream after a broken connection but gives up on an HTTP error, and it
 * allows six connections to a host: so a stream that was refused is opened again here, and a tab
 * that nobody looks at closes its own.
 */

import type { LiveEvent } from './types';

const PATH = '/api/v1/stream';
const RETRY_FIRST_MS = 1_000;
const RETRY_MAX_MS = 15_000;

export type StreamState = 'connecting' | 'live' | 'lost';

/** Listener of the stream. */
export interface StreamListener {
  message(event: LiveEvent): void;
  /**
   * Called when the stream has begun; `again` if only its topics changed and nothing was missed.
   */
  ready(again: boolean): void;
  /** Called when the stream broke, or could not be opened. */
  lost(): void;
}

export class LiveStream {
  state = $state<StreamState>('connecting');
  #listener: StreamListener;
  #names: readonly LiveEvent['event'][];
  #topics: readonly string[] = [];
  #source: EventSource | undefined;
  /** Former stream, which is received until its successor is open, so that nothing is missed. */
  #former: EventSource | undefined;
  #retry: ReturnType<typeof setTimeout> | undefined;
  #wait_ms = RETRY_FIRST_MS;

  constructor(names: readonly LiveEvent['event'][], listener: StreamListener) {
    this.#names = names;
    this.#listener = listener;
  }

  /** Subscribes to these topics from now on. */
  follow(topics: readonly string[]): void {
    if (topics.join() === this.#topics.join()) return;
    this.#topics = topics;
    if (!this.#source) return;
    if (this.#former) this.#source.close();
    else this.#former = this.#source;
    this.#open();
  }

  /**
   * Opens the stream and keeps it open while the page is visible; returns a function that ends it.
   */
  run(): () => void {
    const onVisible = () => {
      if (document.hidden) this.#close();
      else if (!this.#source) this.#open();
    };
    document.addEventListener('visibilitychange', onVisible);
    onVisible();
    return () => {
      document.removeEventListener('visibilitychange', onVisible);
      this.#close();
    };
  }

  #open(): void {
    clearTimeout(this.#retry);
    const source = new EventSource(`${PATH}?topics=${encodeURIComponent(this.#topics.join())}`);
    this.#source = source;
    source.addEventListener('ready', () => {
      const again = this.#former !== undefined;
      this.#leaveFormer();
      this.#listener.ready(again);
    });
    source.onopen = () => {
      this.state = 'live';
      this.#wait_ms = RETRY_FIRST_MS;
    };
    source.onerror = () => {
      if (source !== this.#source) return;
      this.#leaveFormer();
      this.state = 'lost';
      this.#listener.lost();
      if (source.readyState !== EventSource.CLOSED) return;
      this.#close();
      this.#retry = setTimeout(() => this.#open(), this.#wait_ms);
      this.#wait_ms = Math.min(this.#wait_ms * 2, RETRY_MAX_MS);
    };
    for (const name of this.#names) {
      source.addEventListener(name, (event: MessageEvent<string>) => {
        this.#listener.message({ event: name, data: JSON.parse(event.data) } as LiveEvent);
      });
    }
  }

  #leaveFormer(): void {
    this.#former?.close();
    this.#former = undefined;
  }

  #close(): void {
    this.#leaveFormer();
    clearTimeout(this.#retry);
    this.#source?.close();
    this.#source = undefined;
  }
}
