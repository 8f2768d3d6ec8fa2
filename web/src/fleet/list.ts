/** Which robots a list shows, and in which order. */

import type { ParameterName, Robot, RobotState } from '../api/types';
import { CALIBRATED } from '../units/parameters';
import { urgency } from './states';

/** What lists go by. */
export type Listed = Pick<Robot, 'id' | 'state'>;

/** What the reader asked to see; it stands in the address. */
export interface Filter {
  /** A state, or null for every state. */
  state: string | null;
  /** Part of an id. */
  text: string;
}

/** The filter in an address. */
export function filterOf(query: URLSearchParams): Filter {
  const state = query.get('state');
  return { state, text: query.get('q')?.trim() ?? '' };
}

/** Whether a robot passes a filter. */
export function matches(robot: Listed, filter: Filter): boolean {
  if (filter.state !== null && robot.state !== filter.state) return false;
  return robot.id.toLowerCase().includes(filter.text.toLowerCase());
}

const byId = new Intl.Collator('en', { numeric: true });

/** Worst first; robots in the same state stay in the order of their ids, so that rows rest. */
export function compare(a: Listed, b: Listed): number {
  return urgency(a.state) - urgency(b.state) || byId.compare(a.id, b.id);
}

/** How many robots are in each state, worst first; states without robots are left out. */
export function counts(robots: Iterable<Listed>): [state: RobotState, count: number][] {
  const found = new Map<RobotState, number>();
  for (const { state } of robots) found.set(state, (found.get(state) ?? 0) + 1);
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
