/** The fleet as the pages see it: read once, then kept up by the event stream. */

import { get, Refusal } from '../api/client';
import { LiveStream } from '../api/stream.svelte';
import type { Estimate, Robot, RobotState } from '../api/types';
import { now } from '../ui/time.svelte';

/** Updates are shown together this often, however many robots send. */
const SHOW_EVERY_MS = 500;
/** The whole fleet is read again this often, for what the stream does not carry. */
const REREAD_EVERY_MS = 30_000;
const PAGE_ROBOTS = 500;

/** One robot. What changes is a single value, so only its own row is worked over. */
export class RobotEntry {
  readonly id: string;
  robot = $state.raw() as Robot;
  /** Of its own, so that lists are only sorted again when a state changes. */
  readonly state = $derived(this.robot.state);

  constructor(robot: Robot) {
    this.id = robot.id;
    this.robot = robot;
  }
}

export type Loaded = 'loading' | 'ready' | 'failed';

interface StateUpdate {
  robot: string;
  state: RobotState;
  stale: boolean;
  alive: boolean;
}

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
  #states = new Map<string, StateUpdate>();
  #strangers = new Set<string>();
  #listeners = new Set<FleetListener>();

  constructor() {
    this.stream = new LiveStream(['estimate', 'robot_state', 'event'], {
      open: () => void this.load(),
      message: (name, data) => this.#take(name, data),
    });
  }

  /** Starts reading and listening; returns how to stop. */
  run(): () => void {
    const stop = this.stream.run();
    const show = setInterval(() => this.#show(), SHOW_EVERY_MS);
    const reread = setInterval(() => void this.load(), REREAD_EVERY_MS);
    void this.load();
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
      const robots = await readRobots();
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
      this.problem = error instanceof Refusal ? error.message : String(error);
      if (this.loaded === 'loading') this.loaded = 'failed';
    }
  }

  /** Reads one robot, which may be new. */
  async loadRobot(id: string): Promise<void> {
    const robot = (await get<Robot>(`/robots/${encodeURIComponent(id)}`)).body;
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
      const update = data as StateUpdate;
      this.#states.set(update.robot, update);
    } else {
      const { robot } = data as { robot: string };
      for (const listener of this.#listeners) listener.event?.(robot);
    }
  }

  /** Shows what has come since the last time. */
  #show(): void {
    if (this.#estimates.size === 0 && this.#states.size === 0) return;
    const seen_ms = now.current();
    this.heard_ms = seen_ms;
    const last_seen_at = new Date(seen_ms).toISOString();
    for (const [id, estimate] of this.#estimates) {
      const entry = this.#entry(id);
      if (!entry) continue;
      const connection = { ...entry.robot.connection, last_seen_at, stale: false };
      entry.robot = { ...entry.robot, estimate, connection };
    }
    for (const [id, { state, stale, alive }] of this.#states) {
      const entry = this.#entry(id);
      if (!entry) continue;
      const connection = { ...entry.robot.connection, stale, alive };
      entry.robot = { ...entry.robot, state, connection };
    }
    this.#estimates.clear();
    this.#states.clear();
  }

  /** The entry of a robot; one that is not there yet is read. */
  #entry(id: string): RobotEntry | undefined {
    const entry = this.entries.get(id);
    if (!entry && !this.#strangers.has(id)) {
      this.#strangers.add(id);
      this.loadRobot(id)
        .catch(() => undefined)
        .finally(() => this.#strangers.delete(id));
    }
    return entry;
  }
}

/** What a page may want to hear as it comes, before it is shown. */
export interface FleetListener {
  estimate?(estimate: Estimate): void;
  event?(robot: string): void;
}

async function readRobots(): Promise<Robot[]> {
  const robots: Robot[] = [];
  let after: string | null = null;
  do {
    const query: string = after === null ? '' : `&after=${encodeURIComponent(after)}`;
    const page: { items: Robot[]; next: string | null } = (
      await get<{ items: Robot[]; next: string | null }>(`/robots?limit=${PAGE_ROBOTS}${query}`)
    ).body;
    robots.push(...page.items);
    after = page.next;
  } while (after !== null);
  return robots;
}

export const fleet = new Fleet();
