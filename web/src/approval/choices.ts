/** Selection of proposals to be approved together. */

import type { Proposal } from '../api/types';
import { whyNotMine } from './proposal';

/** Version of each selected proposal, by its number. */
export type Chosen = ReadonlyMap<number, number>;

/** Returns the proposals that can be selected, and the selection after each click. */
export function choices(proposals: readonly Proposal[], chosen: Chosen, name: string) {
  const open = proposals.filter((one) => whyNotMine(one, name) === '');
  return {
    /** Proposals that `name` can approve. */
    open,
    /** True if all of them are selected. */
    all: open.length > 0 && open.every(({ id }) => chosen.has(id)),
    /** Returns the selection with or without one of them. */
    with({ id, version }: Proposal, on: boolean): Chosen {
      const next = new Map(chosen);
      if (on) next.set(id, version);
      else next.delete(id);
      return next;
    },
    /** Returns the selection of all of them, or an empty one. */
    withAll(on: boolean): Chosen {
      return new Map(on ? open.map(({ id, version }) => [id, version]) : []);
    },
  };
}
