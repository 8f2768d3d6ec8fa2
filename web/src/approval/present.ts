/** The current estimate beside a proposal: whether the proposed values still hold. */

import { againstApplied } from '../fleet/comparison';
import type { Proposal, Robot } from '../api/types';
import { type Compared, compareValues, difference } from '../units/values';

/** Distance from the proposed values, in sigmas, beyond which the estimate has moved on. */
const OUTDATED_SIGMAS = 3;

export interface Present {
  /** Proposed values (`from`) and the current estimate (`to`), value by value. */
  values: Compared[];
  /** Distance of the value that has moved most, in sigmas. */
  sigmas: number;
  /** Name of that value. */
  moved: Compared['name'];
  /** True if the proposed values still hold; null while the estimate is unknown. */
  holds: boolean | null;
  /** True if a reported reassembly is open: data from before it do not hold. */
  reassembled: boolean;
}

/**
 * Compares a proposal with its robot's current estimate; undefined without one, and for values that
 * were not measured. The current estimate contains the data of the proposal, so the variance of
 * their difference is the proposal's less the current one: the larger of the two sigmas bounds it.
 * The service decides by the same rule.
 */
export function presentOf({ revision }: Proposal, robot: Robot | undefined): Present | undefined {
  const now = robot && againstApplied(robot, undefined);
  if (!now || !revision.evidence) return undefined;
  const sigmas = compareValues(null, revision.values, revision.sigmas, undefined);
  const values = now.map((one, i): Compared => {
    const proposed = sigmas[i];
    const change =
      one.to === null || proposed?.to == null ? null : difference(one.name, proposed.to, one.to);
    const sigma = proposed?.sigma == null ? null : Math.max(proposed.sigma, one.sigma ?? 0);
    return {
      ...one,
      from: proposed?.to ?? null,
      change,
      sigmas: change === null || sigma === null ? null : Math.abs(change) / sigma,
    };
  });
  const most = values.reduce((a, b) => ((b.sigmas ?? 0) > (a.sigmas ?? 0) ? b : a));
  const far = most.sigmas ?? 0;
  const reassembled = robot.estimate?.reassembly_open === true;
  const known = !reassembled && robot.state === 'calibrated';
  const holds = known ? far <= OUTDATED_SIGMAS : null;
  return { values, sigmas: far, moved: most.name, holds, reassembled };
}
