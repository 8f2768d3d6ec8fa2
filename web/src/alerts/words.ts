/** What an alert is about and where it stands, in words and shapes. */

import type { AlertKind, AlertState } from '../api/types';
import { STANDINGS } from '../fleet/standing';
import type { Face } from '../ui/face';

/** A kind is a way for a robot to stand, and looks like that. */
export const KINDS: Record<AlertKind, Face> = {
  rollback_failed: STANDINGS.rollback_failed,
  drift: STANDINGS.drift,
  verification_failed: STANDINGS.verification_failed,
  estimator_failed: STANDINGS.failed,
  not_applied: STANDINGS.not_applied,
  out_of_sync: STANDINGS.out_of_sync,
  no_data: STANDINGS.no_data,
  fault: STANDINGS.fault,
};

export const STATES: Record<AlertState, Face> = {
  pending: {
    word: 'Pending',
    shape: 'half',
    tone: 'quiet',
    meaning: 'It is so, but not for long enough to alert.',
  },
  alerting: {
    word: 'Alerting',
    shape: 'octagon',
    tone: 'bad',
    meaning: 'It is so, and somebody should act.',
  },
  recovering: {
    word: 'Recovering',
    shape: 'arrow',
    tone: 'active',
    meaning: 'It is no longer so; the alert ends when that lasts.',
  },
  no_data: {
    word: 'No data',
    shape: 'ring-broken',
    tone: 'warn',
    meaning:
      'It was alerting, and nothing comes from the robot that would say whether it still is.',
  },
  normal: {
    word: 'Over',
    shape: 'check',
    tone: 'quiet',
    meaning: 'It ended.',
  },
};
