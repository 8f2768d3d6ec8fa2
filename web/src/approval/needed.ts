/** Number of approvals that a proposal needs now, from the data that the pages have. */

import type { Proposal } from '../api/types';
import { fleet } from '../fleet/fleet.svelte';
import { approvals } from './approvals.svelte';
import { approvalsNeeded } from './proposal';

/** Returns the number by the policy in force and the calibration in use by the robot. */
export function neededOf(proposal: Proposal): number {
  const in_use = fleet.entries.get(proposal.robot)?.robot.calibration.in_use;
  return approvalsNeeded(proposal, in_use, approvals.policy.value?.two_approvers_beyond);
}
