/** What waits for a decision, the site-wide stop and the policy, as all pages see them. */

import { list, problemOf } from '../api/client';
import { Reading } from '../api/reading.svelte';
import type { PolicyInForce, Proposal, SiteHold } from '../api/types';
import type { FleetListener } from '../fleet/fleet.svelte';

/** Everything is read again this often, for what the event stream does not tell. */
const REREAD_EVERY_MS = 20_000;
/** Changes that come together are read together. */
const GATHER_MS = 250;
const WAITING_MAX = 5000;

class Desk {
  /** Proposals that wait, newest first. */
  waiting = $state.raw<readonly Proposal[]>([]);
  loaded = $state<'loading' | 'ready' | 'failed'>('loading');
  problem = $state('');
  hold = new Reading<SiteHold>(() => '/site/hold');
  policy = new Reading<PolicyInForce>(() => '/policy');
  /** Moves with every change of the life cycle that the service has told. */
  changes = $state(0);
  #gathering: ReturnType<typeof setTimeout> | undefined;

  /** Hears of changes. */
  readonly listener: FleetListener = {
    approval: () => this.#later(),
    resync: () => this.#later(),
  };

  /** Starts reading; returns how to stop. */
  run(): () => void {
    void this.load();
    const stops = [this.hold.run(REREAD_EVERY_MS), this.policy.run(REREAD_EVERY_MS)];
    const timer = setInterval(() => void this.load(), REREAD_EVERY_MS);
    return () => {
      for (const stop of stops) stop();
      clearInterval(timer);
      clearTimeout(this.#gathering);
    };
  }

  /** Reads what waits. */
  async load(): Promise<void> {
    try {
      this.waiting = await list<Proposal>('/proposals', { state: 'proposed' }, WAITING_MAX);
      this.loaded = 'ready';
      this.problem = '';
    } catch (error) {
      this.problem = problemOf(error);
      if (this.loaded === 'loading') this.loaded = 'failed';
    }
  }

  #later(): void {
    clearTimeout(this.#gathering);
    this.#gathering = setTimeout(() => {
      this.changes++;
      void this.load();
      void this.hold.load();
    }, GATHER_MS);
  }
}

export const desk = new Desk();
