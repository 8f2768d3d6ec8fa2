/**
 * View of the fleet that the address has: the service selects and sorts the robots, since the
 * language of queries is its own.
 */

import { untrack } from 'svelte';
import { get, problemOf } from '../api/client';
import type { RobotsOfView } from '../api/types';
import type { Filter } from './list';

/** Rest after the last key that is typed into a query. */
const TYPED_MS = 200;
/** Interval at which a view is evaluated again: robots enter and leave it. */
const AGAIN_EVERY_MS = 3_000;

/** Orders of the list. Without one the robots that need attention come first. */
export const ORDERS = [
  { sort: '', words: 'Needs attention first' },
  { sort: '-deviation', words: 'Largest deviation first' },
  { sort: '-age', words: 'Longest silent first' },
  { sort: 'site', words: 'By site' },
  { sort: 'type', words: 'By vehicle type' },
  { sort: 'id', words: 'By name' },
] as const;

/** Returns the query of a filter, with what its buttons have chosen. */
export function queryOf({ text, state, connection }: Filter): string {
  const chosen = [state && `standing:${state}`, connection && `connection:${connection}`];
  return [text, ...chosen].filter(Boolean).join(' ');
}

/** Returns the parameters of a view in the API, without those that are empty. */
export function viewQuery(q: string, sort: string, format = ''): string {
  const given = Object.entries({ q, sort, format }).filter(([, value]) => value !== '');
  return new URLSearchParams(given).toString();
}

/** Returns a condition that a property has this value. */
export function condition(property: 'site' | 'type' | 'tag', value: string): string {
  return `${property}:"${value.replace(/["\\]/g, '\\$&')}"`;
}

class View {
  /** Ids of the robots in their order; null while all robots are shown, or none are known yet. */
  robots = $state.raw<readonly string[] | null>(null);
  /** Reason why the service refuses the query, in a sentence. */
  problem = $state('');
  /** True while the robots of the query are not known yet. */
  waits = $state(false);

  /** Follows a query and order; returns a function that stops it. */
  follow(q: string, sort: string): () => void {
    if (q === '' && sort === '') {
      this.robots = null;
      this.problem = '';
      this.waits = false;
      return () => undefined;
    }
    // The view follows the address alone, not what it has found.
    const waits = untrack(() => this.robots === null);
    this.waits = waits;
    const stop = new AbortController();
    const look = () => void this.#look(viewQuery(q, sort), stop.signal);
    const typed = setTimeout(look, waits ? 0 : TYPED_MS);
    const again = setInterval(look, AGAIN_EVERY_MS);
    return () => {
      clearTimeout(typed);
      clearInterval(again);
      stop.abort();
    };
  }

  async #look(query: string, signal: AbortSignal): Promise<void> {
    try {
      const { body } = await get<RobotsOfView>(`/views/robots?${query}`, signal);
      if (signal.aborted) return;
      const same = this.robots?.join(' ') === body.robots.join(' ');
      if (!same) this.robots = body.robots;
      this.problem = '';
    } catch (error) {
      // What was found before stays in view beside the reason.
      if (!signal.aborted) this.problem = problemOf(error);
    }
    this.waits = false;
  }
}

export const view = new View();
