/** Deviation of a robot's estimate from the calibration in use at the time. */

import type { HistoryDocument, Robot, Tolerance, Values } from '../api/types';
import type { AppliedStep } from '../robot/applied';
import { CALIBRATED } from '../units/parameters';
import { accepted, type Calibrated, difference, valueOf } from '../units/values';
import { againstApplied } from './comparison';

/**
 * Returns the calibration in use by a robot at a time. Without steps nothing was ever deployed, and
 * it is `in_use` throughout; before the first step these are the factory values, if the step
 * records them.
 */
export function usedAt(
  steps: readonly AppliedStep[],
  in_use: Values | null | undefined,
  t_s: number,
): Values | null {
  const [first] = steps;
  if (!first) return in_use ?? null;
  const step = steps.findLast((one) => one.t_s <= t_s) ?? (first.generation === 0 ? first : null);
  return step?.values ?? null;
}

/**
 * Returns the deviation of each point from the calibration in use then, in tolerances: the largest
 * of the four values. Null at times without a known calibration.
 */
export function deviations(
  history: Pick<HistoryDocument, 'time' | 'series'>,
  steps: readonly AppliedStep[],
  in_use: Values | null | undefined,
  tolerance: Tolerance,
): (number | null)[] {
  return history.time.map((time, i) => {
    const used = usedAt(steps, in_use, Date.parse(time) / 1000);
    let worst: number | null = null;
    for (const { parameter, mean, status } of history.series) {
      const name = CALIBRATED.find((one) => one === parameter);
      const value = mean[i] ?? null;
      const at = name && valueOf(used, name);
      if (!name || at == null || value === null || status[i] !== 'converged') continue;
      const off = Math.abs(difference(name, at, value)) / accepted(tolerance, name);
      worst = Math.max(worst ?? 0, off);
    }
    return worst;
  });
}

/** End of the scale of bars and sparklines, tolerances. */
const SCALE_END = 15;

/**
 * Returns the place of a deviation on that scale, 0 to 1. All bars and lines share it, so that they
 * can be compared; it is a logarithm, so that a slow drift shows beside a knock.
 */
export function along(tolerances: number): number {
  return Math.min(1, Math.log1p(tolerances) / Math.log1p(SCALE_END));
}

/** Deviation of a robot: that of the value which is farthest, as the service works it out. */
export interface Deviation {
  /** Size in tolerances; null while none is known. */
  worst: number | null;
  /** Name of that value. */
  name: Calibrated | null;
}

/**
 * Returns the signed deviation of each value from the calibration in use, in tolerances, for a
 * picture of all four; null for a value that is not converged or has nothing to compare with.
 */
export function tolerancesOff(robot: Robot, tolerance: Tolerance | undefined): (number | null)[] {
  const compared = againstApplied(robot, tolerance);
  return CALIBRATED.map((name, i) => {
    const change = compared?.[i]?.change ?? null;
    const known = robot.estimate?.parameters[name].status === 'converged';
    return tolerance && known && change !== null ? change / accepted(tolerance, name) : null;
  });
}

/** Returns the present deviation of a robot. */
export function deviationOf({ deviation }: Pick<Robot, 'deviation'>): Deviation {
  if (!deviation) return { worst: null, name: null };
  const name = CALIBRATED.find((one) => one === deviation.parameter) ?? null;
  return { worst: deviation.tolerances, name };
}
