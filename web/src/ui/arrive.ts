/** Motion of a state that has changed. */

import { prefersReducedMotion } from 'svelte/motion';
import type { TransitionConfig } from 'svelte/transition';

const DURATION_MS = 150;
const DISTANCE_PX = 4;

/** Moves a new element into place, without fading: it is readable in every frame. */
export const arrive: (element: Element) => TransitionConfig = () => {
  if (prefersReducedMotion.current) return { duration: 0 };
  return {
    duration: DURATION_MS,
    css: (done) => `transform: translateY(${(done - 1) * DISTANCE_PX}px)`,
  };
};
