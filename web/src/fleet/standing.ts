/** How a robot stands, in one word: its estimate, its calibration's life cycle and its alerts. */

import type { AlertKind, DeploymentState, Robot, RobotState, Tolerance } from '../api/types';
import { type Face, faceOf } from '../ui/face';
import { againstApplied } from './comparison';
import type { Connection } from './connection';

export type Standing =
  | 'rollback_failed'
  | 'drift'
  | 'verification_failed'
  | 'two_senders'
  | 'false_report'
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
    word: 'Rollback failed',
    shape: 'back',
    tone: 'bad',
    meaning: 'The previous calibration was not restored: stop this robot.',
  },
  drift: {
    word: 'Drift',
    shape: 'diamond',
    tone: 'bad',
    meaning: 'The estimate differs significantly from the calibration in use.',
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
  false_report: {
    word: 'False report',
    shape: 'square-cross',
    tone: 'bad',
    meaning: 'An answer in the robot’s name contradicts another: one was not the robot’s.',
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
    meaning: 'The robot did not apply the calibration that was approved for it.',
  },
  out_of_sync: {
    word: 'Out of sync',
    shape: 'split',
    tone: 'warn',
    meaning: 'The robot uses a different calibration from the expected one.',
  },
  no_data: {
    word: 'Silent',
    shape: 'ring-broken',
    tone: 'warn',
    meaning: 'The robot is set up and sends no data.',
  },
  fault: {
    word: 'Fault',
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
  waiting: {
    word: 'Awaiting approval',
    shape: 'clock',
    tone: 'warn',
    meaning: 'New values are proposed and need approval.',
  },
  under_way: {
    word: 'Deploying',
    shape: 'arrow',
    tone: 'active',
    meaning: 'New values are approved and are being sent, applied or verified.',
  },
  uncalibrated: {
    word: 'Uncalibrated',
    shape: 'ring-dot',
    tone: 'warn',
    meaning: 'It uses its factory values, which differ significantly from the estimate.',
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

/** The kind of a drift alert as its robot stands: what was never calibrated cannot have drifted. */
export function driftOf({ calibration }: Pick<Robot, 'calibration'>): Standing {
  return calibration.reported_generation ? 'drift' : 'uncalibrated';
}

/** A robot as it stands apart from its connection: one in maintenance is not missed. */
export function standingIn(robot: Robot, connection: Connection): Robot {
  const missed = connection !== 'maintenance' || robot.state !== 'no_data';
  return missed ? robot : { ...robot, state: 'learning' };
}

/**
 * The most urgent of what is so. `firing` are the kinds of its alerts that fire; `stale` those that
 * fired until the robot fell silent. The values of a silent robot can be compared without it: of
 * those inside `tolerance` nobody says any more that they drifted.
 */
export function standing(
  robot: Robot,
  firing: ReadonlySet<AlertKind>,
  stale: ReadonlySet<AlertKind> = new Set(),
  tolerance?: Tolerance,
): Standing {
  const { calibration, state } = robot;
  const { deployment } = calibration;
  const so: Standing[] = [OF_STATE[state] ?? (state as Standing)];
  const fires = (kind: AlertKind) => firing.has(kind) || stale.has(kind);
  const beyond = () => againstApplied(robot, tolerance)?.some((one) => one.beyond) ?? true;
  if (deployment === 'rollback_failed' || fires('rollback_failed')) so.push('rollback_failed');
  if (firing.has('drift') || (stale.has('drift') && beyond())) so.push(driftOf(robot));
  if (calibration.verification_failed || fires('verification_failed')) {
    so.push('verification_failed');
  }
  if (fires('not_applied')) so.push('not_applied');
  if (fires('out_of_sync')) so.push('out_of_sync');
  if (fires('no_data')) so.push('no_data');
  if (fires('fault')) so.push('fault');
  if (calibration.proposal != null) so.push('waiting');
  if (deployment != null && UNDER_WAY.includes(deployment)) so.push('under_way');
  return so.reduce((worst, one) => (urgency(one) < urgency(worst) ? one : worst));
}
