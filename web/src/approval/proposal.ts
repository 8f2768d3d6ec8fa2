/** Properties of a proposal on which people base a decision. */

import type { ParameterName, Proposal, Tolerance, Values } from '../api/types';
import { faceOf } from '../ui/face';
import { formatDistance, formatSpan } from '../units/format';
import { CALIBRATED } from '../units/parameters';
import { type Compared, compareBeside, compareValues } from '../units/values';
import { PROPOSALS, proposer } from './words';

/** Returns the changes of a proposal, value by value. */
export function changesOf(proposal: Proposal, tolerance: Tolerance | undefined): Compared[] {
  const { values, sigmas } = proposal.revision;
  return compareValues(proposal.base, values, sigmas, tolerance);
}

/** Returns the changes of the other values that it includes: scales, a delay, the wheelbase. */
export function besideOf({ base, revision }: Proposal): Compared[] {
  return compareBeside(base, revision.values, revision.sigmas);
}

/** Returns a summary of its evidence, in a few words. */
export function evidenceOf({ revision }: Proposal): string {
  const { evidence, origin } = revision;
  if (!evidence) return origin === 'person' ? 'none: entered manually' : 'none';
  const span_ms = Date.parse(evidence.to) - Date.parse(evidence.from);
  return `${formatDistance(evidence.distance_m)} in ${formatSpan(span_ms)}`;
}

/** True if `name` has approved it already. */
export function hasAgreed({ approvals }: Proposal, name: string): boolean {
  return approvals.some(({ by }) => by === name);
}

/** Returns the reason why `name` cannot approve it, in a sentence; empty if `name` can. */
export function whyNotMine(proposal: Proposal, name: string): string {
  if (proposal.proposed_by === name) return 'You proposed this: somebody else has to approve it.';
  if (hasAgreed(proposal, name)) return 'You approved. One more approval is needed.';
  return '';
}

/** Returns the listed proposals at their selected versions; those that changed are removed. */
export function stillChosen(
  waiting: readonly Proposal[],
  chosen: ReadonlyMap<number, number>,
): Proposal[] {
  return waiting.filter(({ id, version }) => chosen.get(id) === version);
}

/** Margin shown before and after the evidence, as a fraction of its length. */
const MARGIN = 0.25;
/** Time shown around a proposal without measured evidence. */
const BARE_S = 1800;

/** Returns the stretch of the robot's history that belongs to it, s since 1970. */
export function around({ revision, created }: Proposal): { from_s: number; to_s: number } {
  const created_s = Date.parse(created) / 1000;
  const { evidence } = revision;
  if (!evidence) return { from_s: created_s - BARE_S, to_s: created_s + BARE_S };
  const from_s = Date.parse(evidence.from) / 1000;
  const to_s = Date.parse(evidence.to) / 1000;
  const margin_s = Math.max(10, (to_s - from_s) * MARGIN);
  return { from_s: from_s - margin_s, to_s: to_s + margin_s };
}

/**
 * Returns the number of approvals that it needs by the policy in force: at least the number it was
 * proposed with. `in_use` are the values in use by the robot.
 */
export function approvalsNeeded(
  proposal: Proposal,
  in_use: Values | null | undefined,
  two: Tolerance | undefined,
): number {
  const { values, sigmas } = proposal.revision;
  const compared = compareValues(in_use ?? proposal.base, values, sigmas, two);
  const large = compared.some(({ beyond }) => beyond);
  return Math.max(proposal.approvals_needed, large ? 2 : 1);
}

/** Returns the last action on it, in a sentence without its full stop: `approved by ada`. */
export function lastDone({ state, approvals, approvals_needed, closing }: Proposal): string {
  const last = closing ?? approvals.at(-1);
  const by = last ? ` by ${proposer(last.by)}` : '';
  if (state !== 'proposed') return `${faceOf(PROPOSALS, state).word.toLowerCase()}${by}`;
  if (approvals.length === 0) return 'awaiting approval';
  const given = `${approvals.length} of ${Math.max(approvals_needed, approvals.length + 1)} approvals`;
  return `awaiting approval, with ${given}, the last${by}`;
}

/** Returns the time of its decision, or of its proposal while it is open: ms since 1970. */
function decidedAt_ms({ closing, approvals, created }: Proposal): number {
  return Date.parse((closing ?? approvals.at(-1))?.at ?? created);
}

/** Returns the decided proposals, the most recent decision first. */
export function decidedOf(proposals: readonly Proposal[]): Proposal[] {
  const decided = proposals.filter(({ state }) => state !== 'proposed');
  return decided.toSorted((a, b) => decidedAt_ms(b) - decidedAt_ms(a) || b.id - a.id);
}

/**
 * Returns the proposals for robots whose calibration in use is unknown: so is the size of their
 * change.
 */
export function withoutBase(proposals: readonly Proposal[]): Proposal[] {
  return proposals.filter(({ base }) => base == null);
}

/** Largest change of one parameter among several proposals. */
export interface Largest {
  name: ParameterName;
  /** Change in the wire unit. */
  change: number;
  robot: string;
}

/** Returns for each parameter the proposal that changes it most. */
export function largestOf(proposals: readonly Proposal[]): Largest[] {
  return CALIBRATED.flatMap((name) => {
    let largest: Largest | undefined;
    for (const proposal of proposals) {
      const found = changesOf(proposal, undefined).find((one) => one.name === name);
      if (found?.change == null) continue;
      if (!largest || Math.abs(found.change) > Math.abs(largest.change)) {
        largest = { name, change: found.change, robot: proposal.robot };
      }
    }
    return largest ? [largest] : [];
  });
}
