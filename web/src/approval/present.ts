/** The current estimate beside a proposal: whether the proposed values still hold. */

import { againstApplied } from '../fleet/comparison';
import type { Proposal, Robot } from '../api/types';
import { type Compared, compareValues, difference } from '../units/values';

export interface Present {
  /** Proposed values (`from`) and the current estimate (`to`), value by value. */
  values: Compared[];
  /** Distance of the value that has moved most, in sigmas. */
  sigmas: number;
  /** True if the proposed values still hold; null while the estimate is unknown. */
  holds: boolean | null;
  /** True if a reported reassembly is open: data from before it do not hold. */
  reassembled: boolean;
}

/**
 * Compares a proposal with its robot's current estimate; undefined without one, and for values that
 * were not measured. The service decides if it holds (`outdated`). The distance in sigmas is only
 * displayed: the current estimate contains the data of the proposal, so the larger of the two sigmas
 * bounds that of their difference.
 */
export function presentOf(
  { revision, outdated }: Proposal,
  robot: Robot | undefined,
): Present | undefined {
  const now = robot && againstApplied(robot, undefined);
  if (!now || !revision.evidence) return undefined;
  const proposedBy = compareValues(null, revision.values, revision.sigmas, undefined);
  const values = now.map((one, i): Compared => {
    const proposed = proposedBy[i];
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
  const sigmas = Math.max(...values.map((one) => one.sigmas ?? 0));
  const reassembled = robot.estimate?.reassembly_open === true;
  const known = !reassembled && robot.state === 'calibrated';
  const holds = outdated ? false : known || null;
  return { values, sigmas, holds, reassembled };
}
