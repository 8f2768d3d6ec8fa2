/** How far a robot's estimate was from what it used at the time. */

import type { HistoryDocument, Tolerance, Values } from '../api/types';
import type { AppliedStep } from '../robot/applied';
import { CALIBRATED } from '../units/parameters';
import { accepted, difference, valueOf } from '../units/values';

/**
 * What a robot used at a time. Without steps nothing was ever deployed, and it used `in_use` all
 * along; before the first step it used its factory values, if that is what the step is about.
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
 * How far each point was from what the robot used then, in tolerances: of the four values the one
 * that was furthest. Null where nothing was known.
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
