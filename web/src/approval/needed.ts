/** How many people have to approve a proposal now, by what the pages know. */

import type { Proposal } from '../api/types';
import { fleet } from '../fleet/fleet.svelte';
import { approvals } from './approvals.svelte';
import { approvalsNeeded } from './proposal';

/** By the policy in force and by what its robot uses now. */
export function neededOf(proposal: Proposal): number {
  const in_use = fleet.entries.get(proposal.robot)?.robot.calibration.in_use;
  return approvalsNeeded(proposal, in_use, approvals.policy.value?.two_approvers_beyond);
}
