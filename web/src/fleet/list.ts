/** Which robots a list shows, and in which order. */

import type { ParameterName, Robot, Standing } from '../api/types';
import { CALIBRATED } from '../units/parameters';
import type { Connection } from './connection';
import { urgency } from './standing';

/** What lists go by. */
export interface Listed {
  id: string;
  standing: Standing;
  connection: Connection;
  /** Whether it is in maintenance, also while it drives. */
  maintained: boolean;
}

/** What the reader asked to see; it stands in the address. */
export interface Filter {
  /** A standing, or null for all. */
  state: string | null;
  /** Whether the robot is heard, or null for all. */
  connection: string | null;
  /** Part of an id. */
  text: string;
}

/** The filter in an address. */
export function filterOf(query: URLSearchParams): Filter {
  const state = query.get('state');
  return { state, connection: query.get('connection'), text: query.get('q')?.trim() ?? '' };
}

/** Whether a robot passes a filter. */
export function matches(robot: Listed, filter: Filter): boolean {
  if (filter.state !== null && robot.standing !== filter.state) return false;
  if (filter.connection !== null && !isHeardAs(robot, filter.connection)) return false;
  return robot.id.toLowerCase().includes(filter.text.toLowerCase());
}

/** Whether a robot counts among those that are heard so. One in maintenance does, also if it drives. */
export function isHeardAs(robot: Listed, connection: string): boolean {
  return connection === 'maintenance' ? robot.maintained : robot.connection === connection;
}

const byId = new Intl.Collator('en', { numeric: true });

/** Worst first; robots of the same standing stay in the order of their ids, so that rows rest. */
export function compare(a: Listed, b: Listed): number {
  return urgency(a.standing) - urgency(b.standing) || byId.compare(a.id, b.id);
}

/** How many robots stand how, worst first; what no robot is in is left out. */
export function counts(robots: Iterable<Listed>): [standing: Standing, count: number][] {
  const found = new Map<Standing, number>();
  for (const { standing } of robots) found.set(standing, (found.get(standing) ?? 0) + 1);
  return [...found].sort(([a], [b]) => urgency(a) - urgency(b));
}

/** What a robot still has to do, each need once, with the parameters that want it. */
export function needs(robot: Robot): { need: string; parameters: ParameterName[] }[] {
  const found = new Map<string, ParameterName[]>();
  for (const name of CALIBRATED) {
    const need = robot.estimate?.parameters[name].needs;
    if (!need) continue;
    found.set(need, [...(found.get(need) ?? []), name]);
  }
  return [...found].map(([need, parameters]) => ({ need, parameters }));
}
