/** What is said above the manoeuvres that a robot should drive. */

import type { Manoeuvres, ParameterName } from '../api/types';
import { SHOWN } from '../units/parameters';

/** Less reduction than this, a natural logarithm, prints as 0 %. */
const REDUCTION_MIN = 0.005;

/** Less information than this prints as 0.0 bits. */
const BITS_MIN = 0.05;

/** Those of `items` that tell something: what a driver is sent to drive for nothing is left out. */
export function telling(items: Manoeuvres['items']): Manoeuvres['items'] {
  const reduces = reducesUncertainty(items);
  return items.filter(({ uncertainty_taken, information_bits }) =>
    reduces ? uncertainty_taken > REDUCTION_MIN : information_bits >= BITS_MIN,
  );
}

/** Whether any of them would shrink a sigma that is too large. */
export function reducesUncertainty(items: Manoeuvres['items']): boolean {
  return items.some(({ uncertainty_taken }) => uncertainty_taken > REDUCTION_MIN);
}

const labels = (names: readonly ParameterName[]) =>
  names.map((name) => SHOWN[name].label).join(', ');

/** What is said where none of them tells anything. */
export function nothingToDrive(wanted: readonly ParameterName[]): string {
  return wanted.length === 0
    ? 'All parameters converged: no manoeuvre would add anything now.'
    : `Not converged yet: ${labels(wanted)}. No single manoeuvre adds more than ordinary driving.`;
}

/**
 * What is missing, and how they are ranked. Nothing is missing only when no parameter is `wanted`,
 * as the head of the page has it too.
 */
export function introduction(wanted: readonly ParameterName[], reduces: boolean): string {
  const open = labels(wanted);
  const ranked = reduces
    ? 'Ranked by uncertainty reduction per metre.'
    : 'Ranked by information per metre.';
  if (open !== '') return `Not converged yet: ${open}. ${ranked}`;
  return reduces ? ranked : `All parameters converged. ${ranked}`;
}
