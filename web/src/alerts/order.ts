/** The order of alerts: what fires before what may, then the worst, then the longest. */

import type { Alert } from '../api/types';
import { KINDS } from './words';

const WORST_FIRST = Object.keys(KINDS);

export function bySeverity(a: Alert, b: Alert): number {
  const pending = Number(a.state === 'pending') - Number(b.state === 'pending');
  const kind = WORST_FIRST.indexOf(a.kind) - WORST_FIRST.indexOf(b.kind);
  return pending || kind || a.began.localeCompare(b.began) || a.id - b.id;
}
