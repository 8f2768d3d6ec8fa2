/** Where the deviations of many robots lie beside each other. */

import { along } from './deviation';

/** A robot's place in a drawing: from the middle, as a share of its half, and its row. */
export interface Dot {
  at: number;
  row: number;
  beyond: boolean;
}

/** Dots nearer than this would cover each other, as a share of the half. */
const APART = 0.055;
/** Dots on top of each other at most: what is more lies in the last row. */
const ROWS_MAX = 5;

/** A dot for each deviation that is known, signed and in tolerances; those of one place are stacked. */
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

/** What is said of a spread: how many are beyond the tolerance, of how many, and the median. */
export function summaryOf(signed: readonly (number | null)[]) {
  const known = signed.filter((value) => value !== null).toSorted((a, b) => a - b);
  const beyond = known.filter((value) => Math.abs(value) > 1).length;
  const upper = known[Math.floor(known.length / 2)];
  const lower = known[Math.ceil(known.length / 2) - 1];
  const median = upper === undefined || lower === undefined ? null : (upper + lower) / 2;
  return { known: known.length, beyond, median };
}
