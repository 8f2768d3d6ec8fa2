/** Active alerts as shared by all pages: read once, then updated by the event stream. */

import { list, problemOf } from '../api/client';
import type { Alert } from '../api/types';
import type { FleetListener } from '../fleet/listener';

const REREAD_EVERY_MS = 60_000;
/** Time over which changes are gathered before they are shown together. */
const GATHER_MS = 300;
const ACTIVE_MAX = 5000;

class Alerts {
  /** Active alerts by their number. */
  active = $state.raw<ReadonlyMap<number, Alert>>(new Map());
  loaded = $state<'loading' | 'ready' | 'failed'>('loading');
  problem = $state('');
  /** Counter of the received changes. */
  changes = $state(0);
  /** Number of firing alerts that nobody has acknowledged. */
  readonly open = $derived(
    [...this.active.values()].filter((alert) => fires(alert) && !alert.acknowledgement).length,
  );
  #told = new Map<number, Alert>();
  #gathering: ReturnType<typeof setTimeout> | undefined;

  /** Receives changes from the event stream. */
  readonly listener: FleetListener = {
    alert: (alert) => this.take(alert),
    resync: () => void this.load(),
  };

  /** Starts reading; returns a function that stops it. */
  run(): () => void {
    void this.load();
    const timer = setInterval(() => void this.load(), REREAD_EVERY_MS);
    return () => {
      clearInterval(timer);
      clearTimeout(this.#gathering);
    };
  }

  /** Reads the active alerts. */
  async load(): Promise<void> {
    try {
      const found = await list<Alert>('/alerts', { state: 'active' }, ACTIVE_MAX);
      this.active = new Map(found.map((alert) => [alert.id, alert]));
      this.loaded = 'ready';
      this.problem = '';
    } catch (error) {
      this.problem = problemOf(error);
      if (this.loaded === 'loading') this.loaded = 'failed';
    }
  }

  /** Stores the current state of an alert. */
  take(alert: Alert): void {
    this.#told.set(alert.id, alert);
    this.#gathering ??= setTimeout(() => this.#show(), GATHER_MS);
  }

  #show(): void {
    this.#gathering = undefined;
    const active = new Map(this.active);
    for (const [id, alert] of this.#told) {
      if (alert.state === 'normal') active.delete(id);
      else if ((active.get(id)?.version ?? 0) <= alert.version) active.set(id, alert);
    }
    this.#told.clear();
    this.active = active;
    this.changes++;
  }
}

/** True if the alert's condition holds; that of a pending or recovering alert is not proven. */
export function fires({ state }: Pick<Alert, 'state'>): boolean {
  return state === 'alerting' || state === 'no_data';
}

export const alerts = new Alerts();
