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
  /** Part of an id. */
  text: string;
}

/** Returns the filter in an address. */
export function filterOf(query: URLSearchParams): Filter {
  const state = query.get('state');
  return { state, connection: query.get('connection'), text: query.get('q')?.trim() ?? '' };
}

/** True if a robot passes a filter. */
export function matches(robot: Listed, filter: Filter): boolean {
  if (filter.state !== null && robot.standing !== filter.state) return false;
  if (filter.connection !== null && !isHeardAs(robot, filter.connection)) return false;
  return robot.id.toLowerCase().includes(filter.text.toLowerCase());
}

/**
 * True if a robot counts under a connection. One in maintenance counts there also while it drives.
 */
export function isHeardAs(robot: Listed, connection: string): boolean {
  return connection === 'maintenance' ? robot.maintained : robot.connection === connection;
}

const byId = new Intl.Collator('en', { numeric: true });

/**
 * Compares by standing, the worst first; equal ones stay in the order of their ids, so that rows
 * rest.
 */
export function compare(a: Listed, b: Listed): number {
  return urgency(a.standing) - urgency(b.standing) || byId.compare(a.id, b.id);
}

/** Counts robots by standing, the worst first; omits empty standings. */
export function counts(robots: Iterable<Listed>): [standing: Standing, count: number][] {
  const found = new Map<Standing, number>();
  for (const { standing } of robots) found.set(standing, (found.get(standing) ?? 0) + 1);
  return [...found].sort(([a], [b]) => urgency(a) - urgency(b));
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
