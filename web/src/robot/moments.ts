/** Moments of a robot, in the words of its page. */

import type { Moment } from '../api/types';
import type { Face } from '../ui/face';

/** Reasons for a moment. */
export const KINDS: Record<Moment['kind'], Face> = {
  fault: {
    word: 'Fault',
    shape: 'cross',
    tone: 'bad',
    meaning: 'A sensor, the estimator or the connection failed.',
  },
  verification_failed: {
    word: 'Not verified',
    shape: 'cross',
    tone: 'bad',
    meaning: 'The verification disagreed with the calibration in use.',
  },
  change: {
    word: 'Change',
    shape: 'triangle',
    tone: 'warn',
    meaning: 'The vehicle is no longer the one that was calibrated.',
  },
  reassembled: {
    word: 'Reassembled',
    shape: 'half',
    tone: 'quiet',
    meaning: 'Somebody reported a reassembly.',
  },
  requested: {
    word: 'Kept',
    shape: 'ring',
    tone: 'quiet',
    meaning: 'Somebody kept the data.',
  },
};

/** Says how much a moment has: `58 s, 2.1 MB`. */
export function extent(moment: Moment): string {
  const duration_s = (Date.parse(moment.to) - Date.parse(moment.from)) / 1000;
  return `${duration_s.toFixed(0)} s, ${(moment.bytes / 1e6).toFixed(1)} MB`;
}
