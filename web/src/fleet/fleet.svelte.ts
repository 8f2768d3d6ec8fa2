/** The fleet as shared by all pages: read once, then updated by the event stream. */

import { get, list, problemOf } from '../api/client';
import { LiveStream } from '../api/stream.svelte';
import type { Estimate, LiveEvent, Robot, RobotRow, RobotStateUpdate } from '../api/types';
import type { Route } from '../routes.svelte';
import { now } from '../ui/time.svelte';
import { CALIBRATED } from '../units/parameters';
import { connectionOf, maintenanceOf } from './connection';
import type { FleetListener } from './listener';

/** Interval at which updates are displayed together, however many robots send. */
const SHOW_EVERY_MS = 500;
/**
 * Interval at which the fleet page reads the whole fleet again, for data absent from the stream.
 */
const REREAD_EVERY_MS = 60_000;
/** Interval at which displayed unregistered robots are read again: no event carries their data. */
const UNREGISTERED_EVERY_MS = 2_000;
const ROBOTS_MAX = 100_000;
/** Number of robots with a simultaneous change of approval above which the whole fleet is read. */
const SINGLE_READS_MAX = 8;
/** Time after which pages are read although the event stream has not opened. */
const OPEN_WITHIN_MS = 1_500;

/** One robot. A change affects a single value, so only its own row is computed again. */
export class RobotEntry {
  readonly id: string;
  robot = $state.raw() as Robot;
  /** Connection, derived separately so that lists are only sorted again when it changes. */
  readonly connection = $derived(connectionOf(this.robot, now.ms));
  /** True if the robot is in maintenance, also while it drives. */
  readonly maintained = $derived(maintenanceOf(this.robot, now.ms) !== undefined);
  /** Standing, derived separately so that lists are only sorted again when it changes. */
  readonly standing = $derived(this.robot.standing);

  constructor(robot: Robot) {
    this.id = robot.id;
    this.robot = robot;
  }
}

/** Names of the received events. */
const NAMES: readonly LiveEvent['event'][] = [
  'resync',
  'estimate',
  'rows',
  'robot_state',
  'event',
  'approval',
  'alert',
  'freeze',
  'policy',
  'rollout',
];
/** Topics of every page: its bar counts alerts and approvals, and shows a deployment freeze. */
const EVERYWHERE = ['alerts', 'approvals', 'deployments'];

/** Returns the topics of a page; `robot` is its robot, on a page about one. */
export function topicsOf(page: Route['page'], robot: string | undefined): string[] {
  if (page === 'fleet') return ['fleet', ...EVERYWHERE];
  return robot === undefined ? EVERYWHERE : [`robot:${robot}`, ...EVERYWHERE];
}

export type Loaded = 'loading' | 'ready' | 'failed';

class Fleet {
  /** Robots by id. The map is replaced when a robot is added or removed. */
  entries = $state.raw<ReadonlyMap<string, RobotEntry>>(new Map());
  loaded = $state<Loaded>('loading');
  /** Reason why the fleet could not be read, in a sentence. */
  problem = $state('');
  /** Time of the service's last event or answer. */
  heard_ms = $state(0);
  /**
   * True if the event stream has opened or failed to. Documents read before that would have to be
   * read again, since they may have changed in between.
   */
  opened = $state(false);
  stream: LiveStream;

  /** The robot of a page whose address does not contain it. */
  about = $state<string>();

  #topics: readonly string[] = EVERYWHERE;
  #estimates = new Map<string, Estimate>();
  #rows = new Map<string, RobotRow>();
  #states = new Map<string, RobotStateUpdate>();
  #approvals = new Set<string>();
  #underWay = new Set<string>();
  #unregisteredRead = 0;
  #listeners = new Set<FleetListener>();

  constructor() {
    this.stream = new LiveStream(NAMES, {
      message: (event) => this.#take(event),
      ready: (again) => (again ? this.#changedTopics() : this.#resync()),
      lost: () => {
        // To say why there is nothing to show, and to notice that the session has ended.
        void this.load();
        this.opened = true;
      },
    });
  }

  /** Starts reading and listening; returns a function that stops both. */
  run(): () => void {
    const stop = this.stream.run();
    const open = setTimeout(() => (this.opened = true), OPEN_WITHIN_MS);
    const show = setInterval(() => this.#show(), SHOW_EVERY_MS);
    const reread = setInterval(() => {
      if (this.#showsAll()) void this.load();
    }, REREAD_EVERY_MS);
    const unregistered = setInterval(() => this.#readUnregistered(), UNREGISTERED_EVERY_MS);
    return () => {
      stop();
      clearInterval(unregistered);
      clearTimeout(open);
      this.opened = false;
      clearInterval(show);
      clearInterval(reread);
    };
  }

  /** Subscribes to the topics of the page from now on. */
  follow(topics: readonly string[]): void {
    this.#topics = topics;
    this.stream.follow(topics);
  }

  /** True if the page shows every robot. */
  #showsAll(): boolean {
    return this.#topics.includes('fleet');
  }

  /** Reads the documents that the former topics did not cover. */
  #changedTopics(): void {
    if (this.#showsAll()) void this.load();
    else if (this.about !== undefined) this.#read(this.about);
  }

  /** Reads everything again after the stream has begun or has lost something. */
  #resync(): void {
    void this.load();
    for (const listener of this.#listeners) listener.resync?.();
    this.opened = true;
  }

  /** Calls `listener` with every event that arrives; returns a function that stops it. */
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

  /** Stores the document of a robot, which may be new. */
  put(robot: Robot): void {
    const { id } = robot;
    const entry = this.entries.get(id);
    if (entry) entry.robot = robot;
    else this.entries = new Map([...this.entries, [id, new RobotEntry(robot)]]);
  }

  #take({ event, data }: LiveEvent): void {
    switch (event) {
      case 'estimate':
        this.#estimates.set(data.robot, data);
        for (const listener of this.#listeners) listener.estimate?.(data);
        break;
      case 'rows':
        for (const row of data) this.#rows.set(row.robot, row);
        break;
      case 'robot_state':
        this.#states.set(data.robot, data);
        break;
      case 'event':
        for (const listener of this.#listeners) listener.event?.(data);
        break;
      case 'alert':
        for (const listener of this.#listeners) listener.alert?.(data);
        break;
      case 'approval':
        this.#approvals.add(data.robot);
        for (const listener of this.#listeners) listener.approval?.(data.robot);
        break;
      case 'freeze':
      case 'policy':
      case 'rollout':
        for (const listener of this.#listeners) listener[event]?.();
        break;
      case 'ready':
      case 'resync':
        this.#resync();
    }
  }

  /** Reads the robots again whose approval has changed. */
  #readApproved(): void {
    const changed = [...this.#approvals];
    this.#approvals.clear();
    // Of a robot that no page shows nothing is read; it is when it is shown.
    if (changed.length <= SINGLE_READS_MAX) for (const id of changed) this.#read(id);
    else if (this.#showsAll()) void this.load();
    else if (this.about !== undefined && changed.includes(this.about)) this.#read(this.about);
  }

  /** Reads the next unregistered robots again: their streams and rates. */
  #readUnregistered(): void {
    const shown = [...this.entries.values()].filter(
      ({ id, robot }) => robot.state === 'unregistered' && (this.#showsAll() || this.about === id),
    );
    const from = this.#unregisteredRead < shown.length ? this.#unregisteredRead : 0;
    for (const { id } of shown.slice(from, from + SINGLE_READS_MAX)) this.#read(id);
    this.#unregisteredRead = from + SINGLE_READS_MAX;
  }

  /** Displays the updates received since the last time. */
  #show(): void {
    this.#readApproved();
    if (this.#estimates.size + this.#rows.size + this.#states.size === 0) return;
    const seen_ms = now.current();
    this.heard_ms = seen_ms;
    const last_seen = new Date(seen_ms).toISOString();
    for (const [id, estimate] of this.#estimates) {
      const entry = this.#entry(id);
      if (!entry) continue;
      entry.robot = { ...withEstimate(entry.robot, estimate), last_seen, stale: false };
    }
    for (const [id, row] of this.#rows) {
      const entry = this.#entry(id);
      if (!entry) continue;
      const robot = withRow(entry.robot, row);
      if (robot) entry.robot = { ...robot, last_seen, stale: false };
      else this.#read(id);
    }
    for (const [id, { state, standing, deviation, stale, alive }] of this.#states) {
      const entry = this.#entry(id);
      if (!entry) continue;
      entry.robot = { ...entry.robot, state, standing, deviation: deviation ?? null, stale, alive };
    }
    this.#estimates.clear();
    this.#rows.clear();
    this.#states.clear();
  }

  /** Returns the entry of a robot; reads one that is missing. */
  #entry(id: string): RobotEntry | undefined {
    const entry = this.entries.get(id);
    if (!entry) this.#read(id);
    return entry;
  }

  /** Reads one robot again, for data absent from the stream. */
  refresh(id: string): void {
    this.#read(id);
  }

  /** Reads one robot, unless that reading is in progress. */
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

/**
 * Returns a robot with a newer estimate. The distance driven since the last one counts for its
 * verification too, which is read less often.
 */
export function withEstimate(robot: Robot, estimate: Estimate): Robot {
  const before_m = robot.estimate?.distance_m;
  const verified_m = robot.verification_distance_m;
  if (before_m === undefined || verified_m == null) return { ...robot, estimate };
  const driven_m = Math.max(0, estimate.distance_m - before_m);
  return { ...robot, estimate, verification_distance_m: verified_m + driven_m };
}

/**
 * Returns a robot with the data of its row; undefined for one whose first estimate has to be read.
 */
export function withRow(robot: Robot, row: RobotRow): Robot | undefined {
  const { estimate } = robot;
  if (!estimate) return undefined;
  const parameters = { ...estimate.parameters };
  CALIBRATED.forEach((name, i) => {
    parameters[name] = {
      ...parameters[name],
      value: row.values[i] ?? parameters[name].value,
      sigma: row.sigmas[i] ?? parameters[name].sigma,
      status: row.status[i] ?? parameters[name].status,
      needs: row.needs?.[i] ?? null,
    };
  });
  const standing = row.standing;
  return withEstimate(
    { ...robot, standing },
    { ...estimate, distance_m: row.distance_m, parameters },
  );
}

/** Returns the address of a robot in the API. */
export function robotUrl(id: string): string {
  return `/robots/${encodeURIComponent(id)}`;
}

export const fleet = new Fleet();
