/** Which proposals are selected, to be approved together. */

import type { Proposal } from '../api/types';
import { whyNotMine } from './proposal';

/** The version of each selected proposal, by its number. */
export type Chosen = ReadonlyMap<number, number>;

/** What can be selected, and what a click makes of what is. */
export function choices(proposals: readonly Proposal[], chosen: Chosen, name: string) {
  const open = proposals.filter((one) => whyNotMine(one, name) === '');
  return {
    /** Proposals that `name` can approve. */
    open,
    /** Whether all of them are selected. */
    all: open.length > 0 && open.every(({ id }) => chosen.has(id)),
    /** The selection with or without one of them. */
    with({ id, version }: Proposal, on: boolean): Chosen {
      const next = new Map(chosen);
      if (on) next.set(id, version);
      else next.delete(id);
      return next;
    },
    /** The selection of all of them, or of none. */
    withAll(on: boolean): Chosen {
      return new Map(on ? open.map(({ id, version }) => [id, version]) : []);
    },
  };
}
