/** Distance to what is not known yet, by the sigmas of the service. */

import type { Manoeuvres, Parameter, Robot } from '../api/types';
import { CALIBRATED } from '../units/parameters';
import type { Calibrated } from '../units/values';
import type { Manoeuvre } from './guide';

type Limits = NonNullable<Manoeuvres['sigma_limits']>;

/** Share of its bar that a parameter fills at most before the service calls it known. */
const ALMOST = 0.95;

/**
 * Returns how much of its accuracy a parameter has, 0 to 1: the sigma at which it is known over its
 * sigma now. It is 1 for what the service calls converged and for nothing else.
 */
export function shareOf({ sigma, status }: Parameter, limit: number): number {
  if (status === 'converged') return 1;
  if (!(sigma > 0)) return 0;
  return Math.min(ALMOST, limit / sigma);
}

/** True for a parameter that is estimated and not known yet. */
function isOpen({ status }: Parameter): boolean {
  return status === 'learning' || status === 'unobservable';
}

/** Way and time to go. */
export interface Way {
  distance_m: number;
  duration_s: number;
}

export interface Left extends Way {
  /** True if a value needs something else than a manoeuvre, whose way is not known. */
  isLeast: boolean;
}

/**
 * Returns the metres of a manoeuvre until a sigma comes to its limit. Information, `1/sigma²`,
 * grows by as much with every metre of it. Null if the manoeuvre adds none.
 */
export function metresFor(sigma: number, limit: number, after: number, distance_m: number) {
  const [now, wanted, then] = [sigma ** -2, limit ** -2, after ** -2];
  if (now >= wanted) return 0;
  return then > now ? (distance_m * (wanted - now)) / (then - now) : null;
}

/**
 * Returns the way until the values are known, each by the manoeuvre that tells most about it per
 * metre: the longest of these ways. Null where no way is known, or nothing is left that a sigma
 * could tell.
 */
export function leftOf(
  robot: Robot,
  ranked: readonly Manoeuvre[],
  limits: Limits | null | undefined,
): Left | null {
  const { estimate } = robot;
  if (!estimate || !limits) return null;
  const ways = CALIBRATED.filter((name) => isOpen(estimate.parameters[name])).map((name) => {
    const { sigma, needs } = estimate.parameters[name];
    // The sigma of a value that waits for something else does not come down by a manoeuvre.
    const isAsked = ranked.some(({ instruction }) => instruction === needs);
    return isAsked ? shortest(name, sigma, ranked, limits) : null;
  });
  const known = ways.filter((way) => way !== null);
  const [longest] = known.sort((a, b) => b.distance_m - a.distance_m);
  return longest ? { ...longest, isLeast: known.length < ways.length } : null;
}

function shortest(
  name: Calibrated,
  sigma: number,
  ranked: readonly Manoeuvre[],
  limits: Limits,
): Way | null {
  const ways = ranked.flatMap(({ sigma_after, distance_m, duration_s }) => {
    const way_m = metresFor(sigma, limits[name], sigma_after[name], distance_m);
    const pace_spm = duration_s / distance_m;
    return way_m === null || way_m === 0
      ? []
      : [{ distance_m: way_m, duration_s: way_m * pace_spm }];
  });
  return ways.reduce<Way | null>(
    (best, way) => (best !== null && best.distance_m <= way.distance_m ? best : way),
    null,
  );
}
