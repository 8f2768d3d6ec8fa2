/** Robot whose numbers are shown beside the list; the address has it. */

import { place, withQuery } from '../routes.svelte';

class Peek {
  id = $derived(place.url.searchParams.get('robot'));

  /** Shows the numbers of a robot, or of none, without a step in the browser's history. */
  show(id: string | null): void {
    place.go(withQuery(place.url, { robot: id }), true);
  }

  /** Hides the numbers, and focuses the button that showed them. */
  close(): void {
    const { id } = this;
    this.show(null);
    const buttons = document.querySelectorAll<HTMLElement>('button[data-peek]');
    [...buttons].find(({ dataset }) => dataset.peek === id)?.focus();
  }
}

export const peek = new Peek();
