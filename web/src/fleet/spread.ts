/** Spread of the deviations of many robots. */

import { along } from './deviation';

/** Place of a robot in the drawing: distance from the middle, as a share of its half, and row. */
export interface Dot {
  at: number;
  row: number;
  beyond: boolean;
}

/** Width of a dot, as a share of the half: nearer ones are stacked. */
const APART = 0.055;
/** Limit of rows: more dots share the last one. */
const ROWS_MAX = 5;

/** Returns a dot for each known deviation, signed and in tolerances; those of one place are stacked. */
export function dotsOf(signed: readonly (number | null)[]): Dot[] {
  const taken = new Map<number, number>();
  return signed.flatMap((value) => {
    if (value === null) return [];
    const at = Math.sign(value) * along(Math.abs(value));
    const place = Math.round(at / APART);
    const row = Math.min(taken.get(place) ?? 0, ROWS_MAX - 1);
    taken.set(place, row + 1);
    return [{ at: place * APART, row, beyond: Math.abs(value) > 1 }];
  });
}

/** Returns how many deviations are known, how many are beyond the tolerance, and the median. */
export function summaryOf(signed: readonly (number | null)[]) {
  const known = signed.filter((value) => value !== null).toSorted((a, b) => a - b);
  const beyond = known.filter((value) => Math.abs(value) > 1).length;
  const upper = known[Math.floor(known.length / 2)];
  const lower = known[Math.ceil(known.length / 2) - 1];
  const median = upper === undefined || lower === undefined ? null : (upper + lower) / 2;
  return { known: known.length, beyond, median };
}
