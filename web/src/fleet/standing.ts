/** How a robot stands, in one word: its estimate, its calibration's life cycle and its alerts. */

import type { AlertKind, DeploymentState, Robot, RobotState } from '../api/types';
import { type Face, faceOf } from '../ui/face';

export type Standing =
  | 'rollback_failed'
  | 'drift'
  | 'verification_failed'
  | 'failed'
  | 'not_applied'
  | 'out_of_sync'
  | 'no_data'
  | 'fault'
  | 'unregistered'
  | 'waiting'
  | 'under_way'
  | 'uncalibrated'
  | 'learning'
  | 'calibrated';

/** All of them, the one that needs a person most first. */
export const STANDINGS: Record<Standing, Face> = {
  rollback_failed: {
    word: 'Roll-back failed',
    shape: 'back',
    tone: 'bad',
    meaning: 'The former calibration should have come back and did not: stop this robot.',
  },
  drift: {
    word: 'Drift',
    shape: 'diamond',
    tone: 'bad',
    meaning: 'The vehicle is surely not as the calibration that it uses says.',
  },
  verification_failed: {
    word: 'Verification failed',
    shape: 'triangle',
    tone: 'bad',
    meaning: 'A fresh estimate disagrees with the calibration that was applied.',
  },
  failed: {
    word: 'Estimator failed',
    shape: 'octagon',
    tone: 'bad',
    meaning: 'The estimator failed too often and was stopped. Its last values stand.',
  },
  not_applied: {
    word: 'Not applied',
    shape: 'cross',
    tone: 'warn',
    meaning: 'The robot did not take what was approved for it.',
  },
  out_of_sync: {
    word: 'Out of sync',
    shape: 'split',
    tone: 'warn',
    meaning: 'The robot uses another calibration than it should.',
  },
  no_data: {
    word: 'No data',
    shape: 'ring-broken',
    tone: 'warn',
    meaning: 'The robot is configured and sends nothing.',
  },
  fault: {
    word: 'Fault',
    shape: 'bolt',
    tone: 'warn',
    meaning: 'A sensor or the LiDAR odometry fails. Nothing is learnt from its data meanwhile.',
  },
  unregistered: {
    word: 'Unregistered',
    shape: 'square-plus',
    tone: 'warn',
    meaning: 'The robot sends, but its vehicle is not known yet.',
  },
  waiting: {
    word: 'Waits for approval',
    shape: 'clock',
    tone: 'warn',
    meaning: 'New values are proposed and wait for somebody to approve them.',
  },
  under_way: {
    word: 'Being applied',
    shape: 'arrow',
    tone: 'active',
    meaning: 'New values are approved and on their way, or are being verified by driving.',
  },
  uncalibrated: {
    word: 'Not calibrated yet',
    shape: 'ring-dot',
    tone: 'warn',
    meaning: 'It drives by what it brought along, and is surely off from that.',
  },
  learning: {
    word: 'Learning',
    shape: 'half',
    tone: 'active',
    meaning: 'The parameters are on their way.',
  },
  calibrated: {
    word: 'Calibrated',
    shape: 'check',
    tone: 'good',
    meaning: 'Every parameter that the motions can tell is inside its limit.',
  },
};

export const BY_URGENCY = Object.keys(STANDINGS) as Standing[];

/** Standings that ask for a person. */
export function needsPerson(standing: Standing): boolean {
  const { tone } = faceOf(STANDINGS, standing);
  return tone === 'bad' || tone === 'warn';
}

/** How urgent a standing is: 0 first. One that this page does not know yet comes before. */
export function urgency(standing: Standing): number {
  return BY_URGENCY.indexOf(standing);
}

const UNDER_WAY: readonly DeploymentState[] = [
  'queued',
  'offered',
  'applied',
  'verifying',
  'rolling_back',
];

const OF_STATE: Partial<Record<RobotState, Standing>> = {
  unregistered: 'unregistered',
  no_data: 'no_data',
  failed: 'failed',
  changed: 'drift',
  learning: 'learning',
  calibrated: 'calibrated',
};

/** The most urgent of what is so; `firing` are the kinds of its alerts that fire. */
export function standing(robot: Robot, firing: ReadonlySet<AlertKind>): Standing {
  const { calibration, state } = robot;
  const { deployment } = calibration;
  const so: Standing[] = [OF_STATE[state] ?? (state as Standing)];
  if (deployment === 'rollback_failed' || firing.has('rollback_failed')) so.push('rollback_failed');
  // What was never calibrated here cannot have drifted: generation 0 is what it brought along.
  if (firing.has('drift')) so.push(calibration.reported_generation ? 'drift' : 'uncalibrated');
  if (calibration.verification_failed || firing.has('verification_failed')) {
    so.push('verification_failed');
  }
  if (firing.has('not_applied')) so.push('not_applied');
  if (firing.has('out_of_sync')) so.push('out_of_sync');
  if (firing.has('no_data')) so.push('no_data');
  if (firing.has('fault')) so.push('fault');
  if (calibration.proposal != null) so.push('waiting');
  if (deployment != null && UNDER_WAY.includes(deployment)) so.push('under_way');
  return so.reduce((worst, one) => (urgency(one) < urgency(worst) ? one : worst));
}
