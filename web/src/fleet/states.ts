/** The states of a robot and of a parameter: their words, their shapes, how urgent they are. */

import type { ParameterStatus, RobotState } from '../api/types';

/** A shape is never used for two meanings, so that a state is told without its colour. */
export type Shape =
  'octagon' | 'diamond' | 'ring-broken' | 'square-plus' | 'half' | 'check' | 'ring' | 'dash';
export type Tone = 'bad' | 'warn' | 'active' | 'good' | 'quiet';

export interface Face {
  word: string;
  shape: Shape;
  tone: Tone;
  /** What the state means, in a sentence. */
  meaning: string;
}

export const ROBOT_STATES: Record<RobotState, Face> = {
  failed: {
    word: 'Estimator failed',
    shape: 'octagon',
    tone: 'bad',
    meaning: 'The estimator failed too often and was stopped. Its last values stand.',
  },
  changed: {
    word: 'Changed',
    shape: 'diamond',
    tone: 'bad',
    meaning: 'The vehicle is no longer the one that was calibrated. New values are being learnt.',
  },
  no_data: {
    word: 'No data',
    shape: 'ring-broken',
    tone: 'warn',
    meaning: 'The robot is configured and sends nothing.',
  },
  unregistered: {
    word: 'Unregistered',
    shape: 'square-plus',
    tone: 'warn',
    meaning: 'The robot sends, but its vehicle is not known yet.',
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

/** All states, the one that needs a person most first. */
export const BY_URGENCY = Object.keys(ROBOT_STATES) as RobotState[];

export const STATUSES: Record<ParameterStatus, Omit<Face, 'meaning'>> = {
  converged: { word: 'converged', shape: 'check', tone: 'good' },
  learning: { word: 'learning', shape: 'half', tone: 'active' },
  unobservable: { word: 'unobservable', shape: 'ring', tone: 'warn' },
  fixed: { word: 'fixed', shape: 'dash', tone: 'quiet' },
  off: { word: 'off', shape: 'dash', tone: 'quiet' },
};

/** How urgent a state is: 0 first. A state that this page does not know yet comes first too. */
export function urgency(state: RobotState): number {
  return BY_URGENCY.indexOf(state);
}

/** The face of a state, also of one that a newer service has and this page does not. */
export function robotFace(state: string): Face {
  return (
    ROBOT_STATES[state as RobotState] ?? {
      word: state.replaceAll('_', ' '),
      shape: 'diamond',
      tone: 'warn',
      meaning: 'This page is older than the service: reload it.',
    }
  );
}
