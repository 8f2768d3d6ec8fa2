/** Whose numbers stand beside the list of robots; the address says so. */

import { place, withQuery } from '../routes.svelte';

class Peek {
  id = $derived(place.url.searchParams.get('robot'));

  /** Shows those of a robot, or none. The browser's history keeps no step of it. */
  show(id: string | null): void {
    place.go(withQuery(place.url, { robot: id }), true);
  }

  /** Hides them, and goes back to the button that showed them. */
  close(): void {
    const { id } = this;
    this.show(null);
    const buttons = document.querySelectorAll<HTMLElement>('button[data-peek]');
    [...buttons].find(({ dataset }) => dataset.peek === id)?.focus();
  }
}

export const peek = new Peek();
