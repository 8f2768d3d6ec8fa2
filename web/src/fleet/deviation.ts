/** How far a robot's estimate was from what it used at the time. */

import type { HistoryDocument, Robot, Tolerance, Values } from '../api/types';
import type { AppliedStep } from '../robot/applied';
import { CALIBRATED } from '../units/parameters';
import { accepted, type Calibrated, difference, valueOf } from '../units/values';
import { againstApplied } from './comparison';

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

/** Where the scale of bars and sparklines ends, tolerances: what is farther off ends there too. */
const SCALE_END = 15;

/**
 * How far along that scale a deviation lies, 0 to 1. All bars and lines share it, so that they can
 * be compared; it is a logarithm, so that a slow drift shows beside a knock.
 */
export function along(tolerances: number): number {
  return Math.min(1, Math.log1p(tolerances) / Math.log1p(SCALE_END));
}

/** How far a robot's estimate is from what it uses, in tolerances. */
export interface Deviation {
  /** Value by value, in the order of {@link CALIBRATED}; null where one is not known. */
  each: (number | null)[];
  /** That of the value which is farthest; null while none is known. */
  worst: number | null;
  /** Which value that is. */
  name: Calibrated | null;
}

/**
 * How far each value of a robot's estimate is from what it uses, in tolerances with its sign; null
 * for one that is not converged or has nothing to compare with. The service has no such figure in
 * its answers: this is the pages' own, out of the served estimate, values in use and tolerance
 * (`propose_beyond`).
 */
export function tolerancesOff(robot: Robot, tolerance: Tolerance | undefined): (number | null)[] {
  const compared = againstApplied(robot, tolerance);
  return CALIBRATED.map((name, i) => {
    const change = compared?.[i]?.change ?? null;
    const known = robot.estimate?.parameters[name].status === 'converged';
    return tolerance && known && change !== null ? change / accepted(tolerance, name) : null;
  });
}

/** The deviation of a robot now. */
export function deviationOf(robot: Robot, tolerance: Tolerance | undefined): Deviation {
  const each = tolerancesOff(robot, tolerance).map((one) => one && Math.abs(one));
  const worst = Math.max(-1, ...each.map((one) => one ?? -1));
  if (worst < 0) return { each, worst: null, name: null };
  return { each, worst, name: CALIBRATED[each.indexOf(worst)] ?? null };
}
