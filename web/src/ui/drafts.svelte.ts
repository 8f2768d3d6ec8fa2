/**
 * Texts that were typed and not sent yet. They outlive their page, so that neither a link nor the
 * end of a session loses them, and belong to one person.
 */

import { SvelteMap } from 'svelte/reactivity';

class Drafts {
  #owner = '';
  readonly #kept = new SvelteMap<string, unknown>();

  /** Sets the person who types. The texts of another person are removed. */
  belongTo(owner: string): void {
    if (owner === this.#owner) return;
    this.#owner = owner;
    this.#kept.clear();
  }

  /** Returns the draft kept under a name; undefined without one. */
  get<T>(name: string): T | undefined {
    return this.#kept.get(name) as T | undefined;
  }

  /** Keeps a draft under a name, in place of an earlier one. */
  keep(name: string, draft: unknown): void {
    if (draft === '') this.#kept.delete(name);
    else this.#kept.set(name, draft);
  }

  /** Removes a draft that was sent or cancelled. */
  forget(name: string): void {
    this.#kept.delete(name);
  }
}

export const drafts = new Drafts();
