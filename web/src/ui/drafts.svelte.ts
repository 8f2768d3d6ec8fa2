/**
 * Texts that were typed and not sent yet. They outlive the page that they were typed on, so that
 * neither a link nor a session that ends loses them, and belong to one person.
 */

import { SvelteMap } from 'svelte/reactivity';

class Drafts {
  #owner = '';
  readonly #kept = new SvelteMap<string, unknown>();

  /** Says who types now. What somebody else has typed is forgotten. */
  belongTo(owner: string): void {
    if (owner === this.#owner) return;
    this.#owner = owner;
    this.#kept.clear();
  }

  /** What was kept under a name; undefined when nothing was. */
  get<T>(name: string): T | undefined {
    return this.#kept.get(name) as T | undefined;
  }

  /** Keeps something under a name, in place of what was there. */
  keep(name: string, draft: unknown): void {
    if (draft === '') this.#kept.delete(name);
    else this.#kept.set(name, draft);
  }

  /** Forgets what was sent or given up. */
  forget(name: string): void {
    this.#kept.delete(name);
  }
}

export const drafts = new Drafts();
