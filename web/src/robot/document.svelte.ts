/** The document of one robot, read again periodically for data absent from the event stream. */

import { get, Refusal } from '../api/client';
import type { RobotDocument } from '../api/types';
import { fleet, robotUrl } from '../fleet/fleet.svelte';

const REREAD_EVERY_MS = 5_000;

export class RobotReading {
  readonly id: string;
  details = $state.raw<RobotDocument>();
  /** Reason why the last reading failed. */
  problem = $state<Refusal>();

  constructor(id: string) {
    this.id = id;
  }

  /** Reads the document now. */
  async read(): Promise<void> {
    try {
      const { body } = await get<RobotDocument>(robotUrl(this.id));
      this.details = body;
      this.problem = undefined;
      fleet.put(body);
    } catch (error) {
      this.problem = error instanceof Refusal ? error : new Refusal(String(error), 0);
    }
  }

  /** Reads the document now and periodically; returns a function that stops it. */
  run(): () => void {
    void this.read();
    const timer = setInterval(() => void this.read(), REREAD_EVERY_MS);
    return () => clearInterval(timer);
  }
}
