/** A robot's applied calibrations over time: the step line in its charts. */

import type { Deployment, ParameterName, RobotEvent, Shadow, Values } from '../api/types';
import { valueOf } from '../units/values';

/** Calibration that a robot applied from `t_s` until the next step. */
export interface AppliedStep {
  t_s: number;
  values: Values;
  generation: number;
}

/** A value from a time on; null while it is unknown. */
export interface Step {
  t_s: number;
  value: number | null;
}

function stepOf(time: string, given: unknown): AppliedStep[] {
  if (typeof given !== 'object' || given === null) return [];
  const { values, generation } = given as { values?: Values | null; generation?: number | null };
  if (!values) return [];
  return [{ t_s: Date.parse(time) / 1000, values, generation: generation ?? 0 }];
}

/**
 * Returns the applied calibrations, oldest first, from the robot's records: its calibrations in use
 * and used before, the events of its answers, and the base of each deployment.
 */
export function appliedSteps(
  shadow: Shadow | undefined,
  events: readonly RobotEvent[],
  deployments: readonly Deployment[],
): AppliedStep[] {
  const steps = [
    ...[shadow?.in_use, shadow?.before].flatMap((use) => (use ? stepOf(use.since, use) : [])),
    ...deployments.flatMap(({ base }) => (base ? stepOf(base.since, base) : [])),
    ...events
      .filter(({ kind }) => kind === 'applied' || kind === 'rolled_back')
      .flatMap(({ time, details }) => stepOf(time, details)),
  ].toSorted((a, b) => a.t_s - b.t_s);
  return steps.filter((step, i) => steps[i - 1]?.generation !== step.generation);
}

/** Returns the steps of one parameter. */
export function stepsOf(steps: readonly AppliedStep[], name: ParameterName): Step[] {
  return steps.map(({ t_s, values }) => ({ t_s, value: valueOf(values, name) }));
}

/** Returns the value at a time, or null. */
export function appliedAt(steps: readonly Step[], t_s: number): number | null {
  return steps.findLast((step) => step.t_s <= t_s)?.value ?? null;
}

/** Returns the values of the steps that are visible between two times. */
export function seenValues(steps: readonly Step[], from_s: number, to_s: number): number[] {
  const seen = steps.filter((step, i) => {
    const until_s = steps[i + 1]?.t_s ?? Number.POSITIVE_INFINITY;
    return step.t_s <= to_s && until_s >= from_s;
  });
  return seen.flatMap(({ value }) => (value === null ? [] : [value]));
}
