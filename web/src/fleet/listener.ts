/** Events that the stream delivers to its listeners. */

import type { Alert, Estimate, RobotEvent } from '../api/types';

/** Listener of events on their arrival, before they are displayed. */
export interface FleetListener {
  estimate?(estimate: Estimate): void;
  event?(event: RobotEvent): void;
  /** Called when the approval of a robot's calibration has changed. */
  approval?(robot: string): void;
  alert?(alert: Alert): void;
  /** Called when the deployment freeze began or ended. */
  freeze?(): void;
  /** Called when the approval policy changed. */
  policy?(): void;
  /** Called when a roll-out changed. */
  rollout?(): void;
  /** Called when events may have been missed. */
  resync?(): void;
}
