/** Words and shapes for the states of roll-outs and the stages of their robots. */

import type { Rollout, RolloutLost, RolloutStage, RolloutState, WavePlan } from '../api/types';
import type { Face } from '../ui/face';

export const STATES: Record<RolloutState, Face> = {
  running: {
    word: 'Running',
    shape: 'half',
    tone: 'active',
    meaning: 'Its begun waves release their robots.',
  },
  paused: {
    word: 'Paused',
    shape: 'pause',
    tone: 'warn',
    meaning: 'A person paused it: no further robot is released.',
  },
  halted: {
    word: 'Halted',
    shape: 'octagon',
    tone: 'bad',
    meaning: 'Something is wrong: no further robot is released.',
  },
  finished: {
    word: 'Finished',
    shape: 'check',
    tone: 'good',
    meaning: 'Every robot has an outcome.',
  },
};

/** Stages in the order of a robot's way, the failed ones first. */
export const STAGES: Record<RolloutStage, Face> = {
  failed: {
    word: 'Failed',
    shape: 'cross',
    tone: 'bad',
    meaning: 'The robot refused the calibration or went back, or its verification failed.',
  },
  released: {
    word: 'Being approved',
    shape: 'clock',
    tone: 'active',
    meaning: 'Its wave has begun. Where two people have to approve, the second one is awaited.',
  },
  underway: {
    word: 'Under way',
    shape: 'half',
    tone: 'active',
    meaning: 'The calibration is sent to the robot, or is being verified.',
  },
  verified: {
    word: 'Verified',
    shape: 'check',
    tone: 'good',
    meaning: 'A verification estimate agrees with the calibration.',
  },
  left_out: {
    word: 'Left out',
    shape: 'dash',
    tone: 'quiet',
    meaning: 'Its proposal was changed or closed, or its deployment ended without a verdict.',
  },
  waiting: {
    word: 'Waiting',
    shape: 'ring',
    tone: 'quiet',
    meaning: 'Its wave has not begun.',
  },
};

export const STAGE_ORDER = Object.keys(STAGES) as RolloutStage[];

/** Returns the lost robots of each wave, as they were read. */
export function lostOf(rollout: Rollout): RolloutLost[] {
  return rollout.waves.map(({ counts }) => ({
    failed: counts?.failed ?? 0,
    left_out: counts?.left_out ?? 0,
  }));
}

/** Returns the consequence of resuming a roll-out: after a halt, its lost robots are accepted. */
export function resumptionOf(rollout: Rollout): string {
  if (rollout.state !== 'halted') {
    return 'Robots are released again. Nothing is accepted: too many failures halt it as before.';
  }
  const lost = lostOf(rollout);
  const failed = lost.reduce((sum, wave) => sum + wave.failed, 0);
  const leftOut = lost.reduce((sum, wave) => sum + wave.left_out, 0);
  return `Robots are released again. You accept ${failed} failed and ${leftOut} left out: only further ones halt it.`;
}

/** Returns the robots that a wave takes, in words. */
export function takeOf(take: WavePlan['take']): string {
  if (take === 'rest') return 'the rest';
  if ('robots' in take) return take.robots === 1 ? '1 robot' : `${take.robots} robots`;
  if ('share' in take) return `${percentOf(take.share)} %`;
  return take.q;
}

/** Returns a share as a percentage, without the last bits of its binary form. */
export function percentOf(share: number): number {
  return Math.round(share * 1e4) / 100;
}
