/** A proposal as people decide on it. */

import type { Proposal, Tolerance } from '../api/types';
import { formatDistance, formatSpan } from '../units/format';
import { type Compared, compareBeside, compareValues } from '../units/values';

/** What it changes, value by value. */
export function changesOf(proposal: Proposal, tolerance: Tolerance | undefined): Compared[] {
  const { values, sigmas } = proposal.revision;
  return compareValues(proposal.base, values, sigmas, tolerance);
}

/** What goes along with that and would change: scales, a delay, the wheelbase. */
export function besideOf({ base, revision }: Proposal): Compared[] {
  return compareBeside(base, revision.values, revision.sigmas);
}

/** What it rests on, in a few words. */
export function evidenceOf({ revision }: Proposal): string {
  const { evidence, origin } = revision;
  if (!evidence) return origin === 'person' ? 'none: typed in by a person' : 'none';
  const span_ms = Date.parse(evidence.to) - Date.parse(evidence.from);
  return `${formatDistance(evidence.distance_m)} in ${formatSpan(span_ms)}`;
}

/** Whether `name` has agreed to it already. */
export function hasAgreed({ approvals }: Proposal, name: string): boolean {
  return approvals.some(({ by }) => by === name);
}

/** Why `name` cannot agree to it, in a sentence; empty when nothing speaks against it. */
export function whyNotMine(proposal: Proposal, name: string): string {
  if (proposal.proposed_by === name) return 'You proposed this: somebody else has to approve it.';
  if (hasAgreed(proposal, name)) return 'You have agreed. Somebody else has to agree too.';
  return '';
}

/** The proposals that stand in the list as they were chosen; those that changed drop out. */
export function stillChosen(
  waiting: readonly Proposal[],
  chosen: ReadonlyMap<number, number>,
): Proposal[] {
  return waiting.filter(({ id, version }) => chosen.get(id) === version);
}

/** How much of the evidence's length is shown before and after it. */
const MARGIN = 0.25;
/** What is shown around a proposal that rests on nothing measured. */
const BARE_S = 1800;

/** The stretch of the robot's history that belongs to it, s since 1970. */
export function around({ revision, created }: Proposal): { from_s: number; to_s: number } {
  const created_s = Date.parse(created) / 1000;
  const { evidence } = revision;
  if (!evidence) return { from_s: created_s - BARE_S, to_s: created_s + BARE_S };
  const from_s = Date.parse(evidence.from) / 1000;
  const to_s = Date.parse(evidence.to) / 1000;
  const margin_s = Math.max(10, (to_s - from_s) * MARGIN);
  return { from_s: from_s - margin_s, to_s: to_s + margin_s };
}
