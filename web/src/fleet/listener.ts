/** What the event stream tells those who listen to it. */

import type { Alert, Estimate, RobotEvent } from '../api/types';

/** What a page may want to hear as it comes, before it is shown. */
export interface FleetListener {
  estimate?(estimate: Estimate): void;
  event?(event: RobotEvent): void;
  /** Something has changed about what a robot should use. */
  approval?(robot: string): void;
  alert?(alert: Alert): void;
  /** The deployment freeze began or ended. */
  freeze?(): void;
  /** The approval policy changed. */
  policy?(): void;
  /** Something may have been missed. */
  resync?(): void;
}
