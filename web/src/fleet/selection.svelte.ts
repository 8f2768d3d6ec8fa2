/** Robots that are selected in the fleet's list, for one action on all of them. */

class Selection {
  chosen = $state.raw<ReadonlySet<string>>(new Set());
  /** Robot that was selected or deselected last. */
  #last: string | undefined;

  /** Selects a robot or deselects it. */
  set(id: string, on: boolean): void {
    this.#change([id], on);
    this.#last = id;
  }

  /** Selects or deselects the robots of `view` from the last one to `id`. */
  extend(view: readonly string[], id: string, on: boolean): void {
    const from = this.#last === undefined ? -1 : view.indexOf(this.#last);
    const to = view.indexOf(id);
    const first = from < 0 ? to : Math.min(from, to);
    this.#change(view.slice(first, Math.max(from, to) + 1), on);
    this.#last = id;
  }

  /** Selects or deselects all of `view`. */
  setAll(view: readonly string[], on: boolean): void {
    this.#change(view, on);
  }

  /** Deselects all. */
  clear(): void {
    this.chosen = new Set();
    this.#last = undefined;
  }

  #change(ids: readonly string[], on: boolean): void {
    const chosen = new Set(this.chosen);
    for (const id of ids) {
      if (on) chosen.add(id);
      else chosen.delete(id);
    }
    this.chosen = chosen;
  }
}

export const selection = new Selection();
