/** Actions on selected robots, and the requests that carry them out. */

import { alertsOf } from './acknowledged';
import { problemOf } from '../api/client';
import type { ActionTarget, Alert, FleetAction, FleetActionAnswer, Proposal } from '../api/types';

/** Most robots of one request. */
export const AT_ONCE_MAX = 500;

export const KINDS = [
  'maintenance',
  'end_maintenance',
  'acknowledge',
  'propose',
  'approve',
  'reject',
  'retire',
] as const;
export type Kind = (typeof KINDS)[number];

/** What is selected, with what the page shows of it. */
export interface Picked {
  ids: readonly string[];
  /** Selected robots in maintenance. */
  maintained: readonly string[];
  proposals: readonly Proposal[];
  alerts: readonly Alert[];
}

/** Returns the robots on which an action is possible, with what was read of each. */
export function targetsOf(kind: Kind, picked: Picked): ActionTarget[] {
  const selected = new Set(picked.ids);
  switch (kind) {
    case 'end_maintenance':
      return picked.maintained.map((id) => ({ id }));
    case 'acknowledge':
      return [...alertsOf(picked.ids, picked.alerts)].map(([id, alerts]) => ({ id, alerts }));
    case 'approve':
    case 'reject':
      return picked.proposals
        .filter(({ robot }) => selected.has(robot))
        .map(({ id, robot, version, revision: { sha256 } }) => ({
          id: robot,
          proposal: { id, version, sha256 },
        }));
    default:
      return picked.ids.map((id) => ({ id }));
  }
}

/** Returns the action of a request; `until` is the end of a maintenance. */
export function actionOf(kind: Kind, reason: string, until: string): FleetAction['action'] {
  const optional = reason === '' ? null : reason;
  switch (kind) {
    case 'maintenance':
      return { maintenance: { until, reason } };
    case 'end_maintenance':
      return { maintenance: { until: null, reason } };
    case 'acknowledge':
      return { acknowledge: { note: optional } };
    case 'propose':
      return { propose: { reason } };
    case 'approve':
      return { approve: { reason: optional } };
    case 'reject':
      return { reject: { reason } };
    case 'retire':
      return { retire: { reason } };
  }
}

/** Returns the requests of an action, each for at most {@link AT_ONCE_MAX} robots. */
export function requestsOf(action: FleetAction['action'], robots: ActionTarget[]): FleetAction[] {
  const requests: FleetAction[] = [];
  for (let first = 0; first < robots.length; first += AT_ONCE_MAX) {
    requests.push({ action, robots: robots.slice(first, first + AT_ONCE_MAX) });
  }
  return requests;
}

/** Answers to the requests of an action, and the robots of the requests that had none. */
export interface Answered {
  answers: FleetActionAnswer[];
  failed: { id: string; why: string }[];
}

/**
 * Sends the requests of an action one after another; a failed one does not affect the others.
 *
 * @throws The reason of the first one, if none is answered.
 */
export async function answersTo(
  requests: readonly FleetAction[],
  send: (request: FleetAction) => Promise<FleetActionAnswer>,
): Promise<Answered> {
  const answers: FleetActionAnswer[] = [];
  const failed: Answered['failed'] = [];
  const errors: unknown[] = [];
  for (const request of requests) {
    try {
      answers.push(await send(request));
    } catch (error) {
      errors.push(error);
      failed.push(...request.robots.map(({ id }) => ({ id, why: problemOf(error) })));
    }
  }
  if (answers.length === 0 && errors.length > 0) throw errors[0];
  return { answers, failed };
}

/** Outcomes of an action: robots where it was done, and the reason for each of the others. */
export interface Outcome {
  kind: Kind;
  done: string[];
  refused: { id: string; why: string }[];
}

/** Returns the outcomes of an action; robots of failed requests count as refused. */
export function outcomeOf(kind: Kind, { answers, failed }: Answered): Outcome {
  const items = answers.flatMap((answer) => answer.items);
  return {
    kind,
    done: items.filter(({ done }) => done).map(({ robot }) => robot),
    refused: items
      .flatMap(({ robot, problem }) => (problem ? [{ id: robot, why: problem.detail }] : []))
      .concat(failed),
  };
}

/** Returns the action that takes an outcome back, or undefined if it cannot be taken back. */
export function undoOf(kind: Kind): FleetAction['action'] | undefined {
  const reason = 'Taken back right after it was done.';
  if (kind === 'maintenance') return { maintenance: { until: null, reason } };
  if (kind === 'retire') return { bring_back: { reason } };
  return undefined;
}
