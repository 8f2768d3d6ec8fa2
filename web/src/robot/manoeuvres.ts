/** What is said above the manoeuvres that a robot should drive. */

import type { Manoeuvres, ParameterName } from '../api/types';
import { SHOWN } from '../units/parameters';

/** Whether any of them would shrink a sigma that is too large. */
export function reducesUncertainty(items: Manoeuvres['items']): boolean {
  return items.some(({ uncertainty_taken }) => uncertainty_taken > 0);
}

/**
 * What is missing, and how they are ranked. Nothing is missing only when no parameter is `wanted`,
 * as the head of the page has it too.
 */
export function introduction(wanted: readonly ParameterName[], reduces: boolean): string {
  const open = wanted.map((name) => SHOWN[name].label).join(', ');
  const ranked = reduces
    ? 'Ranked by uncertainty reduction per metre.'
    : 'Ranked by information per metre.';
  if (open !== '') return `Not converged yet: ${open}. ${ranked}`;
  return reduces ? ranked : `All parameters converged. ${ranked}`;
}
