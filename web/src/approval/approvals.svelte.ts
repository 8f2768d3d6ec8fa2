/** Open proposals, the deployment freeze and the policy, as shared by all pages. */

import { list, problemOf } from '../api/client';
import { Reading } from '../api/reading.svelte';
import type { PolicyInForce, Proposal, DeploymentFreeze } from '../api/types';
import type { FleetListener } from '../fleet/listener';

/**
 * Interval at which open proposals are read again: no event reports that one has become outdated.
 */
const REREAD_EVERY_MS = 60_000;
/** Time over which changes are gathered before they are read together. */
const GATHER_MS = 250;
const WAITING_MAX = 5000;

class Approvals {
  /** Open proposals, newest first. */
  waiting = $state.raw<readonly Proposal[]>([]);
  loaded = $state<'loading' | 'ready' | 'failed'>('loading');
  problem = $state('');
  freeze = new Reading<DeploymentFreeze>(() => '/deployments/freeze');
  policy = new Reading<PolicyInForce>(() => '/policy');
  /** Counter of the life cycle's changes received from the service. */
  changes = $state(0);
  /** Counter of the changes of roll-outs received from the service. */
  rollouts = $state(0);
  #gathering: ReturnType<typeof setTimeout> | undefined;

  /** Receives changes from the event stream. */
  readonly listener: FleetListener = {
    approval: () => this.#later(),
    freeze: () => void this.freeze.load(),
    policy: () => void this.policy.load(),
    rollout: () => this.rollouts++,
    resync: () => {
      this.rollouts++;
      this.#later();
      void this.freeze.load();
      void this.policy.load();
    },
  };

  /** Starts reading; returns a function that stops it. */
  run(): () => void {
    void this.load();
    void this.freeze.load();
    void this.policy.load();
    const timer = setInterval(() => void this.load(), REREAD_EVERY_MS);
    return () => {
      clearInterval(timer);
      clearTimeout(this.#gathering);
    };
  }

  /** Reads the open proposals. */
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
    }, GATHER_MS);
  }
}

export const approvals = new Approvals();
