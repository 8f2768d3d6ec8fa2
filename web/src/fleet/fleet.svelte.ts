/** The fleet as the pages see it: read once, then kept up by the event stream. */

import { alerts } from '../alerts/alerts.svelte';
import { get, list, problemOf } from '../api/client';
import { LiveStream } from '../api/stream.svelte';
import type { Alert, Estimate, Robot, RobotEvent, RobotStateUpdate } from '../api/types';
import { now } from '../ui/time.svelte';
import { standing } from './standing';

/** Updates are shown together this often, however many robots send. */
const SHOW_EVERY_MS = 500;
/** The whole fleet is read again this often, for what the stream does not carry. */
const REREAD_EVERY_MS = 30_000;
const ROBOTS_MAX = 100_000;
/** Above so many robots whose approval changed at once, the whole fleet is read instead. */
const SINGLE_READS_MAX = 8;
const NOTHING: ReadonlySet<never> = new Set();

/** One robot. What changes is a single value, so only its own row is worked over. */
export class RobotEntry {
  readonly id: string;
  robot = $state.raw() as Robot;
  /** Of its own, so that lists are only sorted again when it changes. */
  readonly standing = $derived(standing(this.robot, alerts.firing.get(this.robot.id) ?? NOTHING));

  constructor(robot: Robot) {
    this.id = robot.id;
    this.robot = robot;
  }
}

/** What is heard of the event stream. */
const NAMES = ['ready', 'resync', 'estimate', 'robot_state', 'event', 'approval', 'alert'];

export type Loaded = 'loading' | 'ready' | 'failed';

class Fleet {
  /** Every robot by id. The map is replaced when a robot comes or goes. */
  entries = $state.raw<ReadonlyMap<string, RobotEntry>>(new Map());
  loaded = $state<Loaded>('loading');
  /** Why the fleet could not be read, in a sentence. */
  problem = $state('');
  /** When the service last said anything. */
  heard_ms = $state(0);
  stream: LiveStream;

  #estimates = new Map<string, Estimate>();
  #states = new Map<string, RobotStateUpdate>();
  #approvals = new Set<string>();
  #underWay = new Set<string>();
  #listeners = new Set<FleetListener>();

  constructor() {
    this.stream = new LiveStream(NAMES, {
      message: (name, data) => this.#take(name, data),
      lost: () => {
        // To say why there is nothing to show, and to notice that the session has ended.
        void this.load();
      },
    });
  }

  /** Starts reading and listening; returns how to stop. */
  run(): () => void {
    const stop = this.stream.run();
    const show = setInterval(() => this.#show(), SHOW_EVERY_MS);
    const reread = setInterval(() => void this.load(), REREAD_EVERY_MS);
    return () => {
      stop();
      clearInterval(show);
      clearInterval(reread);
    };
  }

  /** Calls `listener` with everything that arrives; returns how to stop. */
  listen(listener: FleetListener): () => void {
    this.#listeners.add(listener);
    return () => this.#listeners.delete(listener);
  }

  /** Reads the whole fleet. */
  async load(): Promise<void> {
    try {
      const robots = await list<Robot>('/robots', {}, ROBOTS_MAX);
      const entries = new Map<string, RobotEntry>();
      for (const robot of robots) {
        const entry = this.entries.get(robot.id);
        if (entry) entry.robot = robot;
        entries.set(robot.id, entry ?? new RobotEntry(robot));
      }
      const same =
        entries.size === this.entries.size &&
        [...entries.keys()].every((id) => this.entries.has(id));
      if (!same) this.entries = entries;
      this.loaded = 'ready';
      this.problem = '';
      this.heard_ms = now.current();
    } catch (error) {
      this.problem = problemOf(error);
      if (this.loaded === 'loading') this.loaded = 'failed';
    }
  }

  /** Takes what was read about one robot, which may be new. */
  put(robot: Robot): void {
    const { id } = robot;
    const entry = this.entries.get(id);
    if (entry) entry.robot = robot;
    else this.entries = new Map([...this.entries, [id, new RobotEntry(robot)]]);
  }

  #take(name: string, data: unknown): void {
    if (name === 'estimate') {
      const estimate = data as Estimate;
      this.#estimates.set(estimate.robot, estimate);
      for (const listener of this.#listeners) listener.estimate?.(estimate);
    } else if (name === 'robot_state') {
      const update = data as RobotStateUpdate;
      this.#states.set(update.robot, update);
    } else if (name === 'event') {
      for (const listener of this.#listeners) listener.event?.(data as RobotEvent);
    } else if (name === 'alert') {
      for (const listener of this.#listeners) listener.alert?.(data as Alert);
    } else if (name === 'approval') {
      const { robot } = data as { robot: string };
      this.#approvals.add(robot);
      for (const listener of this.#listeners) listener.approval?.(robot);
    } else {
      // The stream has begun, or has lost something: everything is read anew.
      void this.load();
      for (const listener of this.#listeners) listener.resync?.();
    }
  }

  /** Reads anew where a calibration stands, of the robots where that has changed. */
  #readApproved(): void {
    const changed = [...this.#approvals];
    this.#approvals.clear();
    if (changed.length > SINGLE_READS_MAX) void this.load();
    else for (const id of changed) this.#read(id);
  }

  /** Shows what has come since the last time. */
  #show(): void {
    this.#readApproved();
    if (this.#estimates.size === 0 && this.#states.size === 0) return;
    const seen_ms = now.current();
    this.heard_ms = seen_ms;
    const last_seen = new Date(seen_ms).toISOString();
    for (const [id, estimate] of this.#estimates) {
      const entry = this.#entry(id);
      if (!entry) continue;
      entry.robot = { ...entry.robot, estimate, last_seen, stale: false };
    }
    for (const [id, { state, stale, alive }] of this.#states) {
      const entry = this.#entry(id);
      if (!entry) continue;
      entry.robot = { ...entry.robot, state, stale, alive };
    }
    this.#estimates.clear();
    this.#states.clear();
  }

  /** The entry of a robot; one that is not there yet is read. */
  #entry(id: string): RobotEntry | undefined {
    const entry = this.entries.get(id);
    if (!entry) this.#read(id);
    return entry;
  }

  /** Reads one robot, unless that is under way. */
  #read(id: string): void {
    if (this.#underWay.has(id)) return;
    this.#underWay.add(id);
    get<Robot>(robotUrl(id))
      .then(({ body }) => this.put(body))
      // The next reading of the whole fleet makes up for it.
      .catch(() => undefined)
      .finally(() => this.#underWay.delete(id));
  }
}

/** What a page may want to hear as it comes, before it is shown. */
export interface FleetListener {
  estimate?(estimate: Estimate): void;
  event?(event: RobotEvent): void;
  /** Something has changed about what a robot should use. */
  approval?(robot: string): void;
  alert?(alert: Alert): void;
  /** Something may have been missed. */
  resync?(): void;
}

/** The address of a robot in the API. */
export function robotUrl(id: string): string {
  return `/robots/${encodeURIComponent(id)}`;
}

export const fleet = new Fleet();
