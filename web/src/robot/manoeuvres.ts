/** Text above the manoeuvres that a robot should drive. */

import type { Manoeuvres, ParameterName } from '../api/types';
import { SHOWN } from '../units/parameters';

/** Reduction, a natural logarithm, below which 0 % is printed. */
const REDUCTION_MIN = 0.005;

/** Information below which 0.0 bits are printed. */
const BITS_MIN = 0.05;

/**
 * Returns the informative ones of `items`: a driver is not sent to drive without gain. What a
 * parameter needs comes first, in the order of `needs`, so that the list begins with the next step
 * at the top of the page; the others stay in the order of the ranking.
 */
export function telling(items: Manoeuvres['items'], needs: readonly string[]): Manoeuvres['items'] {
  const reduces = reducesUncertainty(items);
  const needed = needs.flatMap((need) => items.filter(({ instruction }) => instruction === need));
  const others = items.filter(
    (item) =>
      !needed.includes(item) &&
      (reduces ? item.uncertainty_taken > REDUCTION_MIN : item.information_bits >= BITS_MIN),
  );
  return [...needed, ...others];
}

/** True if any of them would reduce a sigma that is too large. */
export function reducesUncertainty(items: Manoeuvres['items']): boolean {
  return items.some(({ uncertainty_taken }) => uncertainty_taken > REDUCTION_MIN);
}

const labels = (names: readonly ParameterName[]) =>
  names.map((name) => SHOWN[name].label).join(', ');

/** Returns the text shown when none of them is informative. */
export function nothingToDrive(wanted: readonly ParameterName[]): string {
  return wanted.length === 0
    ? 'All parameters converged: no manoeuvre would add anything now.'
    : `Not converged yet: ${labels(wanted)}. No single manoeuvre adds more than ordinary driving.`;
}

/**
 * Describes the missing parameters and the order of the manoeuvres. Nothing is missing only if no
 * parameter is `wanted`, as in the head of the page.
 */
export function introduction(wanted: readonly ParameterName[], reduces: boolean): string {
  const open = labels(wanted);
  const by = `Ranked by ${reduces ? 'uncertainty reduction' : 'information'} per metre`;
  if (open !== '') return `Not converged yet: ${open}. ${by}, after what these need.`;
  return reduces ? `${by}.` : `All parameters converged. ${by}.`;
}
