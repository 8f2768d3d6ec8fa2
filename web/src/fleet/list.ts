/** Filter and order of lists of robots. */

import type { ParameterName, Robot, Standing } from '../api/types';
import { CALIBRATED } from '../units/parameters';
import type { Connection } from './connection';
import { urgency } from './standing';

/** Properties by which lists are filtered and sorted. */
export interface Listed {
  id: string;
  standing: Standing;
  connection: Connection;
  /** True if the robot is in maintenance, also while it drives. */
  maintained: boolean;
}

/** Filter chosen by the reader; stored in the address. */
export interface Filter {
  /** A standing, or null for all. */
  state: string | null;
  /** A connection, or null for all. */
  connection: string | null;
  /** Query, which the service evaluates. */
  text: string;
  /** Order by the service; empty for that of {@link compare}. */
  sort: string;
}

/** Returns the filter in an address. */
export function filterOf(query: URLSearchParams): Filter {
  return {
    state: query.get('state'),
    connection: query.get('connection'),
    text: query.get('q')?.trimStart() ?? '',
    sort: query.get('sort') ?? '',
  };
}

/** True if a robot has the standing and the connection of a filter. */
export function matches(robot: Listed, filter: Filter): boolean {
  if (filter.state !== null && robot.standing !== filter.state) return false;
  return filter.connection === null || isHeardAs(robot, filter.connection);
}

/**
 * Returns the robots of a view, whose ids the service has given, in the order of the view; without
 * ids all robots, and without an order the worst first.
 */
export function inView<T extends Listed>(
  robots: ReadonlyMap<string, T>,
  ids: readonly string[] | null,
  sort: string,
): T[] {
  const found = ids?.flatMap((id) => robots.get(id) ?? []) ?? [...robots.values()];
  return sort === '' ? found.sort(compare) : found;
}

/**
 * True if a robot counts under a connection. One in maintenance counts there also while it drives.
 */
export function isHeardAs(robot: Listed, connection: string): boolean {
  return connection === 'maintenance' ? robot.maintained : robot.connection === connection;
}

const byId = new Intl.Collator('en', { numeric: true });

/** Returns the place of a robot: a silent one comes before those that need nobody. */
function rank({ standing, connection }: Listed): number {
  const own = urgency(standing);
  return connection === 'silent' ? Math.min(own, urgency('no_data')) : own;
}

/**
 * Compares by standing, the worst first; equal ones stay in the order of their ids, so that rows
 * rest.
 */
export function compare(a: Listed, b: Listed): number {
  return rank(a) - rank(b) || byId.compare(a.id, b.id);
}

/** Counts robots by standing, the worst first; omits empty standings. */
export function counts(robots: Iterable<Listed>): [standing: Standing, count: number][] {
  const found = new Map<Standing, number>();
  for (const { standing } of robots) found.set(standing, (found.get(standing) ?? 0) + 1);
  return [...found].sort(([a], [b]) => urgency(a) - urgency(b));
}

/** Returns site, vehicle type and tags of a robot. */
export function groupsText({ site, vehicle_type, tags }: Robot): string {
  return [site, vehicle_type, ...tags].filter(Boolean).join(', ');
}

/** Returns the needs of a robot, each once, with the parameters that have it. */
export function needs(robot: Robot): { need: string; parameters: ParameterName[] }[] {
  const found = new Map<string, ParameterName[]>();
  for (const name of CALIBRATED) {
    const need = robot.estimate?.parameters[name].needs;
    if (!need) continue;
    found.set(need, [...(found.get(need) ?? []), name]);
  }
  return [...found].map(([need, parameters]) => ({ need, parameters }));
}
