/** The present estimate beside a proposal: whether what is proposed still holds. */

import { againstApplied } from '../fleet/comparison';
import type { Proposal, Robot } from '../api/types';
import { type Compared, compareValues, difference } from '../units/values';

export interface Present {
  /** What is proposed (`from`) and the estimate now (`to`), value by value. */
  values: Compared[];
  /** How many sigmas the value that has moved most is away. */
  sigmas: number;
  /** Null while the estimate is not known, and nobody can say. */
  holds: boolean | null;
  /** Whether a reported reassembly is open: nothing from before it holds. */
  reassembled: boolean;
}

/**
 * Compares a proposal with its robot's estimate now; undefined without one, and for values that
 * nobody measured. Whether it holds is the service's word (`outdated`). The distance in sigmas is
 * only shown: the estimate now contains the data of the proposal, so the larger of the two sigmas
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
