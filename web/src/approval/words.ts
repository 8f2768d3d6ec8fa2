/** Where a proposal and a deployment stand, in words and shapes. */

import type { DeploymentState, ProposalState } from '../api/types';
import type { Face } from '../ui/face';

export const PROPOSALS: Record<ProposalState, Face> = {
  proposed: {
    word: 'Waits for a decision',
    shape: 'clock',
    tone: 'warn',
    meaning: 'Nobody has decided on it yet, or not everybody who has to.',
  },
  approved: {
    word: 'Approved',
    shape: 'check',
    tone: 'good',
    meaning: 'It was approved and goes to the robot.',
  },
  rejected: {
    word: 'Rejected',
    shape: 'cross',
    tone: 'quiet',
    meaning: 'Somebody said no. The robot keeps what it applies.',
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
    word: 'Waits to be sent',
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
    word: 'Being verified by driving',
    shape: 'half',
    tone: 'active',
    meaning: 'A fresh estimator, which began from nothing, follows the robot with the new values.',
  },
  verified: {
    word: 'Verified by driving',
    shape: 'check',
    tone: 'good',
    meaning: 'A fresh estimate agrees with what the robot now applies.',
  },
  inconclusive: {
    word: 'Not proven: too little motion',
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
    word: 'Going back to the former values',
    shape: 'back',
    tone: 'warn',
    meaning: 'The former values were sent to the robot as a new generation.',
  },
  rolled_back: {
    word: 'Former values are back',
    shape: 'back',
    tone: 'quiet',
    meaning: 'The robot applies its former values again.',
  },
  rollback_failed: {
    word: 'Roll-back failed',
    shape: 'back',
    tone: 'bad',
    meaning: 'The former values should have come back and did not: stop this robot.',
  },
};

/** Who proposed, in words: `fleetcal` is the service itself. */
export function proposer(name: string): string {
  return name === 'fleetcal' ? 'the estimator' : name;
}
