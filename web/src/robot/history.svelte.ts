/** One robot's history on its page: read for the displayed window, then updated live. */

import { get, Refusal } from '../api/client';
import type {
  Estimate,
  EventPage,
  HistoryDocument,
  Innovation,
  Innovations,
  ParameterName,
  RobotEvent,
} from '../api/types';
import { fleet, robotUrl } from '../fleet/fleet.svelte';
import { now } from '../ui/time.svelte';
import { CALIBRATED } from '../units/parameters';
import { continued, nisOf } from './consistency';
import { isSame, joined } from './events';
import { allSeries, append, EMPTY, type Series } from './series';
import { extent, LIVE_MAX_S, sameWindow, type Window } from './window';
import type { Span } from './zoom';

/**
 * Number of points requested: an hour of seconds, and more than a wide screen has pixels for a
 * chart.
 */
const POINTS_MAX = 4000;
/** Interval at which a range too long to follow live is read again. */
const REREAD_EVERY_MS = 60_000;
const EVENTS_MAX = 100;
/** Number of events from the stream that are kept until their rows are read. */
const HEARD_MAX = 20;

/** Reads the history of a robot in a stretch of time. */
export async function readHistory(
  id: string,
  [from_s, to_s]: Span,
  signal: AbortSignal,
): Promise<HistoryDocument> {
  const query = new URLSearchParams({
    from: new Date(from_s * 1000).toISOString(),
    to: new Date(to_s * 1000 + 1000).toISOString(),
    max_points: String(POINTS_MAX),
    parameter: CALIBRATED.join(','),
  });
  return (await get<HistoryDocument>(`${robotUrl(id)}/history?${query}`, signal)).body;
}

export class History {
  readonly id: string;
  /** Counter of the changes of `series`, which is altered in place. */
  changes = $state(0);
  bucket_s = $state(1);
  loaded = $state<'loading' | 'ready' | 'failed'>('loading');
  problem = $state('');
  /** Events, the newest first: the service's rows, and those received from the stream since. */
  events = $state.raw<RobotEvent[]>([]);
  /** True once the rows of the events have been read. */
  hasEvents = $state(false);
  /** Number of times that the window was read. */
  readings = $state(0);
  /** Innovations that the service keeps, the oldest first; undefined before they are read. */
  innovations = $state.raw<readonly Innovation[]>();
  /** Largest number of innovations that the service keeps. */
  innovations_max = 0;
  /** Stretch of time that is displayed while a gesture goes on. */
  preview = $state.raw<Span | null>(null);
  /** Time under the cursor of all charts, s since 1970. */
  cursor_s = $state<number | null>(null);
  /** True if a key has put it there: it then stays at its time while the charts move on. */
  #isPinned = $state(false);
  #series = new Map<ParameterName, Series>();
  #nis: { t_s: number[]; nis: number[] } = { t_s: [], nis: [] };
  #window: Window;
  #reading: AbortController | undefined;
  #last_s: number | undefined;
  /** Events received from the stream, the newest first. */
  #heard: RobotEvent[] = [];

  constructor(id: string, window: Window) {
    this.id = id;
    this.#window = window;
  }

  /** Returns one parameter of the history. */
  series(name: ParameterName): Series {
    void this.changes;
    return this.#series.get(name) ?? EMPTY;
  }

  /** Returns the normalised innovations squared over time. */
  nis(): { t_s: readonly number[]; nis: readonly number[] } {
    void this.changes;
    return this.#nis;
  }

  /** Puts the cursor at a time by a key, or takes it away. */
  pin(t_s: number | null): void {
    this.cursor_s = t_s;
    this.#isPinned = t_s !== null;
  }

  /** Takes the cursor of a chart, which follows the pointer, unless a key has put it elsewhere. */
  hover(t_s: number | null): void {
    if (!this.#isPinned) this.cursor_s = t_s;
  }

  /** Time at which a key has put the cursor, or null. */
  get pinned_s(): number | null {
    return this.#isPinned ? this.cursor_s : null;
  }

  /** Returns the stretch of time that the charts show. */
  extent(): Span {
    if (this.preview) return this.preview;
    const t_s = this.series('steering_offset').t_s;
    return extent(this.#window, this.end_s(), t_s[0]);
  }

  /** Shows a window; one that is already displayed is not read again. */
  show(window: Window): void {
    this.preview = null;
    if (sameWindow(window, this.#window)) return;
    this.#window = window;
    this.pin(null);
    void this.load();
  }

  /** Reads the history of the window. */
  async load(): Promise<void> {
    this.#reading?.abort();
    const reading = new AbortController();
    this.#reading = reading;
    try {
      const span = extent(this.#window, this.end_s(), undefined);
      const body = await readHistory(this.id, span, reading.signal);
      this.#series = allSeries(body);
      this.#nis = nisOf(body);
      this.bucket_s = body.bucket_s;
      this.loaded = 'ready';
      this.changes++;
      this.readings++;
    } catch (error) {
      if (reading.signal.aborted) return;
      this.problem = error instanceof Refusal ? error.message : String(error);
      this.loaded = 'failed';
    }
  }

  /** Reads the innovations that the service keeps. */
  async loadInnovations(): Promise<void> {
    try {
      const { body } = await get<Innovations>(`${robotUrl(this.id)}/innovations`);
      this.innovations_max = body.kept_max;
      this.innovations = body.items;
    } catch {
      // Their charts stay as they are; the bar over the page says that the service is away.
    }
  }

  /** Reads the robot's events. */
  async loadEvents(): Promise<void> {
    try {
      const path = `${robotUrl(this.id)}/events?limit=${EVENTS_MAX}`;
      const { items } = (await get<EventPage>(path)).body;
      this.events = joined(items, this.#heard);
      this.hasEvents = true;
    } catch {
      // The list stays as it is; the bar over the page says that the service is away.
    }
  }

  /** Reads the robot's events, and follows them; returns a function that stops it. */
  followEvents(): () => void {
    void this.loadEvents();
    return fleet.listen({
      event: (event) => this.takeEvent(event),
      approval: (id) => {
        if (id === this.id) void this.loadEvents();
      },
      // What was missed is in the history.
      resync: () => void this.loadEvents(),
    });
  }

  /** Adds an event on its arrival. Its row may be written later. */
  takeEvent(event: RobotEvent): void {
    if (event.robot !== this.id) return;
    this.#heard = [event, ...this.#heard.filter((one) => !isSame(one, event))].slice(0, HEARD_MAX);
    this.events = joined(this.events, [event]);
  }

  /** Reads the window, and again periodically; returns a function that stops it. */
  run(): () => void {
    void this.load();
    const timer = setInterval(() => {
      if (!this.#follows()) void this.load();
    }, REREAD_EVERY_MS);
    return () => {
      clearInterval(timer);
      this.#reading?.abort();
    };
  }

  /** Adds an estimate on its arrival. */
  take(estimate: Estimate): void {
    if (estimate.robot !== this.id) return;
    this.#takeInnovation(estimate.consistency.innovation);
    if (!this.#follows() || this.loaded !== 'ready') return;
    const t_s = Math.floor(estimate.stamp_ns / 1e9);
    this.#last_s = t_s;
    const last_s = this.#series.get('steering_offset')?.t_s.at(-1);
    if (last_s !== undefined && t_s - last_s < this.bucket_s) return;
    const [oldest_s] = extent(this.#window, t_s, undefined);
    for (const name of CALIBRATED) {
      const series = this.#series.get(name);
      const { status } = estimate.parameters[name];
      if (series && status !== 'fixed' && status !== 'off')
        append(series, t_s, estimate.parameters[name], oldest_s);
    }
    if (estimate.consistency.samples > 0) {
      this.#nis.t_s.push(t_s);
      this.#nis.nis.push(estimate.consistency.nis_mean);
    }
    const kept = this.#nis.t_s.findIndex((t) => t >= oldest_s);
    if (kept > 0) for (const column of Object.values(this.#nis)) column.splice(0, kept);
    this.changes++;
  }

  #takeInnovation(innovation: Innovation | null | undefined): void {
    const kept = this.innovations;
    if (!innovation || !kept) return;
    this.innovations = continued(kept, innovation, this.innovations_max);
  }

  /**
   * Returns the end of a range: now, or the robot's own last stamp if its clock is a different one.
   */
  end_s(): number {
    const now_s = now.current() / 1000;
    if (this.#last_s === undefined) return now_s;
    const length_s = this.#window.kind === 'range' ? this.#window.range.length_s : 0;
    return Math.abs(now_s - this.#last_s) > length_s ? this.#last_s : now_s;
  }

  /** Sets the time of the robot's own clock before its history is read. */
  set last_s(t_s: number) {
    this.#last_s = t_s;
  }

  #follows(): boolean {
    return this.#window.kind === 'range' && this.#window.range.length_s <= LIVE_MAX_S;
  }
}
