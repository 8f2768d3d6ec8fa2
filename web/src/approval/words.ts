/** Words and shapes for the states of proposals and deployments. */

import type { DeploymentState, ProposalState, SecondApprover } from '../api/types';
import type { Face } from '../ui/face';

/** Reasons why two people have to approve a proposal. */
export const SECOND: Record<SecondApprover, string> = {
  beyond: 'the change is beyond the limit for one',
  vehicle: 'a scale, the wheelbase or the time offset changes by much',
  frame: 'base_link moves',
  unknown: 'nothing was approved for this robot yet, and it has no drawing to compare with',
  own_drawing:
    'nothing was approved for this robot yet, and its drawing is of someone who proposes or approves',
};

export const PROPOSALS: Record<ProposalState, Face> = {
  proposed: {
    word: 'Awaiting approval',
    shape: 'clock',
    tone: 'warn',
    meaning: 'It has not been decided, or needs another approval.',
  },
  approved: {
    word: 'Approved',
    shape: 'check',
    tone: 'good',
    meaning: 'It was approved and is deployed to the robot.',
  },
  rejected: {
    word: 'Rejected',
    shape: 'cross',
    tone: 'quiet',
    meaning: 'It was rejected. The robot keeps its calibration.',
  },
  expired: {
    word: 'Expired',
    shape: 'ring-broken',
    tone: 'quiet',
    meaning: 'Nobody decided in time.',
  },
  withdrawn: {
    word: 'Withdrawn',
    shape: 'dash',
    tone: 'quiet',
    meaning: 'It was taken back.',
  },
  superseded: {
    word: 'Superseded',
    shape: 'arrow',
    tone: 'quiet',
    meaning: 'A newer estimate took its place.',
  },
};

export const DEPLOYMENTS: Record<DeploymentState, Face> = {
  queued: {
    word: 'Queued',
    shape: 'clock',
    tone: 'active',
    meaning: 'Approved. It is sent as soon as nothing holds it.',
  },
  offered: {
    word: 'Sent to the robot',
    shape: 'arrow',
    tone: 'active',
    meaning: 'The robot can take it, and has not answered yet. It applies it when it stands still.',
  },
  applied: {
    word: 'Applied by the robot',
    shape: 'half',
    tone: 'active',
    meaning: 'The robot says that it uses the values.',
  },
  verifying: {
    word: 'Verifying',
    shape: 'half',
    tone: 'active',
    meaning:
      'A fresh estimator, which learns from scratch, checks the new values while the robot drives.',
  },
  verified: {
    word: 'Verified',
    shape: 'check',
    tone: 'good',
    meaning:
      'A verification estimate, learned from scratch by driving, agrees with the calibration in use.',
  },
  inconclusive: {
    word: 'Inconclusive: not enough driving',
    shape: 'ring',
    tone: 'warn',
    meaning: 'The robot has not driven enough to tell. The values stay.',
  },
  refused: {
    word: 'Refused by the robot',
    shape: 'cross',
    tone: 'bad',
    meaning: 'The robot did not accept the values; its reason stands beside.',
  },
  failed: {
    word: 'Failed on the robot',
    shape: 'octagon',
    tone: 'bad',
    meaning: 'The robot tried and could not apply the values.',
  },
  timed_out: {
    word: 'No answer in time',
    shape: 'ring-broken',
    tone: 'warn',
    meaning: 'The robot did not take it before it expired.',
  },
  withdrawn: {
    word: 'Withdrawn before it was applied',
    shape: 'dash',
    tone: 'quiet',
    meaning: 'It was taken back before the robot applied it.',
  },
  rolling_back: {
    word: 'Rolling back',
    shape: 'back',
    tone: 'warn',
    meaning: 'The previous values are being sent to the robot as a new generation.',
  },
  rolled_back: {
    word: 'Rolled back',
    shape: 'back',
    tone: 'quiet',
    meaning: 'The robot uses its previous values again.',
  },
  rollback_failed: {
    word: 'Rollback failed',
    shape: 'back',
    tone: 'bad',
    meaning: 'The previous values were not restored: stop this robot.',
  },
  kept: {
    word: 'Kept by decision',
    shape: 'half',
    tone: 'warn',
    meaning:
      'A person rolled the robot back to these values. The estimate disagrees; the robot keeps them until people decide otherwise.',
  },
};

/** Returns the proposer in words: `fleetcal` is the service itself. */
export function proposer(name: string): string {
  return name === 'fleetcal' ? 'the estimator' : name;
}
