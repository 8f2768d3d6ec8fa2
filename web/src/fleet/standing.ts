/** Words and shapes of a robot's standing, which the service computes (`Standing`). */

import type { Standing } from '../api/types';
import { type Face, faceOf } from '../ui/face';

/** Faces of all standings, the one that needs a person most first. */
export const STANDINGS: Record<Standing, Face> = {
  rollback_failed: {
    word: 'Rollback failed',
    shape: 'back',
    tone: 'bad',
    meaning: 'The previous calibration was not restored: stop this robot.',
  },
  drift: {
    word: 'Drift',
    shape: 'diamond',
    tone: 'bad',
    meaning: 'The estimate differs significantly from the approved calibration in use.',
  },
  verification_failed: {
    word: 'Verification failed',
    shape: 'triangle',
    tone: 'bad',
    meaning: 'A verification estimate disagrees with the calibration that was applied.',
  },
  two_senders: {
    word: 'Two senders',
    shape: 'twins',
    tone: 'bad',
    meaning: 'Two senders use this robot’s id. Nothing that they send is used.',
  },
  former_key: {
    word: 'Old Zenoh key',
    shape: 'signpost',
    tone: 'bad',
    meaning: 'The robot sends its wheel odometry on the former key. It is not used.',
  },
  false_report: {
    word: 'Contradicting reports',
    shape: 'square-cross',
    tone: 'bad',
    meaning: 'An answer in the robot’s name contradicts another: one was not the robot’s.',
  },
  estimator_failed: {
    word: 'Estimator failed',
    shape: 'octagon',
    tone: 'bad',
    meaning: 'The estimator failed too often and was stopped. Its last values stand.',
  },
  no_instance: {
    word: 'No instance',
    shape: 'square-dash',
    tone: 'bad',
    meaning: 'No instance of the service estimates this robot. Its last values stand.',
  },
  not_applied: {
    word: 'Robot did not apply',
    shape: 'cross',
    tone: 'warn',
    meaning: 'The robot did not apply the calibration that was approved for it.',
  },
  out_of_sync: {
    word: 'Unexpected values',
    shape: 'split',
    tone: 'warn',
    meaning: 'The robot uses a different calibration from the expected one.',
  },
  fault: {
    word: 'Sensor fault',
    shape: 'bolt',
    tone: 'warn',
    meaning: 'A sensor or the LiDAR odometry fails. Nothing is learned from its data meanwhile.',
  },
  unregistered: {
    word: 'Not set up',
    shape: 'square-plus',
    tone: 'warn',
    meaning: 'The robot sends data, but its vehicle is not configured yet.',
  },
  awaiting_approval: {
    word: 'Awaiting approval',
    shape: 'clock',
    tone: 'warn',
    meaning: 'New values are proposed and need approval.',
  },
  deploying: {
    word: 'Deploying',
    shape: 'arrow',
    tone: 'active',
    meaning: 'New values are approved and are being sent, applied or verified.',
  },
  uncalibrated: {
    word: 'Needs calibration',
    shape: 'ring-dot',
    tone: 'warn',
    meaning: 'The estimate differs from the calibration in use by more than the tolerance.',
  },
  no_data: {
    word: 'No data yet',
    shape: 'ring-broken',
    tone: 'quiet',
    meaning: 'The robot is set up and has sent nothing that can be estimated from.',
  },
  learning: {
    word: 'Calibrating',
    shape: 'half',
    tone: 'active',
    meaning: 'Not enough driving yet: some parameters have not converged.',
  },
  calibrated: {
    word: 'Calibrated',
    shape: 'check',
    tone: 'good',
    meaning: 'All observable parameters have converged.',
  },
};

export const BY_URGENCY = Object.keys(STANDINGS) as Standing[];

/** True for standings that need a person. */
export function needsPerson(standing: Standing): boolean {
  const { tone } = faceOf(STANDINGS, standing);
  return tone === 'bad' || tone === 'warn';
}

/** Returns the urgency of a standing, 0 first. One unknown to this page comes before all others. */
export function urgency(standing: Standing): number {
  return BY_URGENCY.indexOf(standing);
}
