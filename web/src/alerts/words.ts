/** Words and shapes for the subjects and states of alerts. */

import type { Alert, AlertKind, AlertState } from '../api/types';
import { CONNECTIONS } from '../fleet/connection';
import { STANDINGS } from '../fleet/standing';
import type { Face } from '../ui/face';

/**
 * Faces of the kinds of alert. A kind about robots has the face of the corresponding standing; its
 * word differs from that of every state.
 */
export const KINDS: Record<AlertKind, Face> = {
  rollback_failed: STANDINGS.rollback_failed,
  drift: STANDINGS.drift,
  verification_failed: STANDINGS.verification_failed,
  two_senders: STANDINGS.two_senders,
  former_key: STANDINGS.former_key,
  false_report: STANDINGS.false_report,
  estimator_failed: STANDINGS.estimator_failed,
  no_instance: STANDINGS.no_instance,
  not_applied: STANDINGS.not_applied,
  out_of_sync: STANDINGS.out_of_sync,
  no_data: CONNECTIONS.silent,
  fault: STANDINGS.fault,
  uncalibrated: STANDINGS.uncalibrated,
  routers_cut: {
    word: 'Routers cut',
    shape: 'unlinked',
    tone: 'bad',
    meaning: 'Instances of the service do not receive each other.',
  },
  configurations_differ: {
    word: 'Configurations differ',
    shape: 'not-equal',
    tone: 'warn',
    meaning: 'Instances of the service are configured differently.',
  },
  clock_off: {
    word: 'Clock off',
    shape: 'clock-off',
    tone: 'warn',
    meaning: 'The clock of an instance is more than 1 s from that of the database.',
  },
  sessions_full: {
    word: 'Sessions full',
    shape: 'full',
    tone: 'warn',
    meaning: 'All Zenoh sessions of the service, or of one name or address, are taken.',
  },
};

export const STATES: Record<AlertState, Face> = {
  pending: {
    word: 'Pending',
    shape: 'half',
    tone: 'quiet',
    meaning: 'Its condition is met, but not for long enough to alert.',
  },
  alerting: {
    word: 'Alerting',
    shape: 'octagon',
    tone: 'bad',
    meaning: 'Its condition is met, and somebody should act.',
  },
  recovering: {
    word: 'Recovering',
    shape: 'arrow',
    tone: 'active',
    meaning: 'Its condition has cleared; the alert is resolved when that lasts.',
  },
  no_data: {
    word: 'Stale',
    shape: 'dash',
    tone: 'warn',
    meaning:
      'It was alerting, and the robot has sent no data since that would confirm or clear it.',
  },
  normal: {
    word: 'Resolved',
    shape: 'check',
    tone: 'quiet',
    meaning: 'Its condition has cleared.',
  },
};

/** Returns the subject of an alert: a robot, several robots, or the service. */
export function subjectOf({ robot, robots }: Pick<Alert, 'robot' | 'robots'>): string {
  if (robot != null) return robot;
  if (robots.length === 0) return 'Service';
  return robots.length === 1 ? '1 robot' : `${robots.length} robots`;
}
