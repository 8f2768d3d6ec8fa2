/**
 * Order of alerts: firing before pending and recovering ones, then by severity, then the longest
 * first.
 */

import type { Alert, AlertState } from '../api/types';
import { KINDS } from './words';

const WORST_FIRST = Object.keys(KINDS);

const BY_STATE: Record<AlertState, number> = {
  alerting: 0,
  no_data: 0,
  recovering: 1,
  pending: 2,
  normal: 3,
};

export function bySeverity(a: Alert, b: Alert): number {
  const state = BY_STATE[a.state] - BY_STATE[b.state];
  const kind = WORST_FIRST.indexOf(a.kind) - WORST_FIRST.indexOf(b.kind);
  return state || kind || a.began.localeCompare(b.began) || a.id - b.id;
}
