/**
 * What a rollback brings back, as the service decides it: during a deployment the values that the
 * robot used before it; otherwise the last verified ones, and without any those used before.
 */

import type { Deployment, InUse, Shadow, Values } from '../api/types';

/** The values that come back. */
export interface Returned {
  /** The generation under which the robot used them last; 0 for its factory values. */
  generation: number;
  /** Their values; null where the page has to read them from `proposal` first. */
  values: Values | null;
  /** The proposal that they were approved by. */
  proposal: number | null;
  /** When the robot last began to use them. */
  since: string | null;
  /** When driving has verified them; null when it never has. */
  verified: string | null;
}

type Records = Pick<Shadow, 'deployment' | 'in_use' | 'before' | 'verified'>;

/** What a rollback brings back; null when nothing is known that it could. */
export function returned(shadow: Records, deployments: readonly Deployment[]): Returned | null {
  const { deployment, in_use, before, verified } = shadow;
  const live = deployment && !deployment.closed ? deployment : null;
  if (live) return live.base ? of(live.base, deployments) : null;
  const earlier = verified.findLast(({ revision }) => revision !== in_use?.revision);
  if (!earlier) return before ? of(before, deployments) : null;
  const used = [before, ...deployments.map(({ base }) => base ?? null)];
  const known = used.find((one) => one?.revision === earlier.revision);
  if (known) return of(known, deployments);
  const made = deployments.find(({ offer }) => offer.revision === earlier.revision);
  return {
    generation: earlier.generation,
    values: null,
    proposal: made?.proposal ?? null,
    since: made?.applied ?? null,
    verified: verifiedAt(earlier.revision, deployments),
  };
}

function of({ generation, revision, values, since }: InUse, deployments: readonly Deployment[]) {
  return {
    generation,
    values,
    proposal: null,
    since: generation === 0 ? null : since,
    verified: revision == null ? null : verifiedAt(revision, deployments),
  };
}

/** When a revision was verified last; deployments come the newest first. */
export function verifiedAt(revision: number, deployments: readonly Deployment[]): string | null {
  const found = deployments.find(
    ({ offer, state }) => state === 'verified' && offer.revision === revision,
  );
  return found?.closed ?? found?.verification?.at ?? null;
}
