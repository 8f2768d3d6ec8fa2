/** Deviation of a robot's estimate from the calibration in use at the time. */

import type { HistoryDocument, Tolerance, Values } from '../api/types';
import type { AppliedStep } from '../robot/applied';
import { CALIBRATED } from '../units/parameters';
import { accepted, difference, valueOf } from '../units/values';

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
