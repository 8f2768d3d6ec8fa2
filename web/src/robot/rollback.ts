/**
 * Result of a rollback, by the service's rule: during a deployment it restores the calibration in
 * use before it; otherwise the last verified one, and without any the one in use before.
 */

import type { Deployment, InUse, Shadow, Values } from '../api/types';

/** Calibration that a rollback restores. */
export interface Returned {
  /** Generation under which the robot used it last; 0 for its factory values. */
  generation: number;
  /** Values; null if the page has to read them from `proposal` first. */
  values: Values | null;
  /** Proposal that approved them. */
  proposal: number | null;
  /** Time at which the robot last began to use them. */
  since: string | null;
  /** Time at which driving verified them; null if it never has. */
  verified: string | null;
}

type Records = Pick<Shadow, 'deployment' | 'in_use' | 'before' | 'verified'>;

/** Returns the calibration that a rollback restores; null if none is known. */
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

/** Returns the time at which a revision was verified last; deployments come the newest first. */
export function verifiedAt(revision: number, deployments: readonly Deployment[]): string | null {
  const found = deployments.find(
    ({ offer, state }) => state === 'verified' && offer.revision === revision,
  );
  return found?.closed ?? found?.verification?.at ?? null;
}
