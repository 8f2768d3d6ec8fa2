/** The present estimate beside a proposal: whether what is proposed still holds. */

import { againstApplied } from '../fleet/comparison';
import type { Proposal, Robot } from '../api/types';
import { type Compared, compareValues, difference } from '../units/values';

/** Farther from what is proposed than so many sigmas, the estimate has moved on. */
const OUTDATED_SIGMAS = 3;

export interface Present {
  /** What is proposed (`from`) and the estimate now (`to`), value by value. */
  values: Compared[];
  /** How many sigmas the value that has moved most is away. */
  sigmas: number;
  /** That value. */
  moved: Compared['name'];
  /** Null while the estimate is not known: then nobody can say. */
  holds: boolean | null;
  /** Whether a reported reassembly is open: nothing from before it holds. */
  reassembled: boolean;
}

/**
 * Compares a proposal with its robot's estimate now; undefined without one, and for values that
 * nobody measured. The estimate now contains the data of the proposal, so the variance of their
 * difference is that of the proposal less that of now: the larger of the two sigmas bounds it. The
 * service decides by the same rule.
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
