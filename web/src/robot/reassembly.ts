/** Outcome of the latest reassembly: the same calibration as before, another, or not known yet. */

import type { EventKind, Robot, RobotEvent } from '../api/types';
import type { Face } from '../ui/face';

/** Time after a report from which an estimate takes it into account. */
const TAKEN_IN_MS = 10_000;

export type Verdict = 'same' | 'changed' | 'open' | 'nothing_stored' | 'none';

export interface Reassembly {
  /** Reported event. */
  event: RobotEvent;
  verdict: Verdict;
  /** The estimator's event that contains the verdict. */
  by: RobotEvent | null;
}

export const VERDICTS: Record<Verdict, Face> = {
  same: {
    word: 'Unchanged',
    shape: 'check',
    tone: 'good',
    meaning:
      'What was learnt since agrees with what was known just before, within its uncertainty.',
  },
  changed: {
    word: 'Changed',
    shape: 'diamond',
    tone: 'bad',
    meaning: 'What was learnt since differs significantly from what was known just before.',
  },
  open: {
    word: 'Not known yet',
    shape: 'half',
    tone: 'active',
    meaning: 'The robot has to drive until it is calibrated again.',
  },
  nothing_stored: {
    word: 'Nothing to compare with',
    shape: 'ring',
    tone: 'quiet',
    meaning:
      'No finished calibration was known when it was reported. The current one was learned since.',
  },
  none: {
    word: 'No verdict',
    shape: 'ring',
    tone: 'warn',
    meaning:
      'The estimator is comparing nothing now, and said nothing after this report. Report it again if nobody knows whether the calibration still holds.',
  },
};

/** Verdicts by the estimator's events after a report. */
const SAID: Partial<Record<EventKind, Verdict>> = {
  calibration_confirmed: 'same',
  calibration_changed: 'changed',
  calibration_learned: 'nothing_stored',
};

/** Returns the latest reassembly among a robot's events, the newest first; null without one. */
export function reassemblyOf(events: readonly RobotEvent[], robot: Robot): Reassembly | null {
  const at = events.findIndex(({ kind }) => kind === 'reassembled');
  const event = events[at];
  if (!event) return null;
  for (const by of events.slice(0, at).reverse()) {
    const verdict = by.source === 'estimator' ? SAID[by.kind] : undefined;
    if (verdict) return { event, verdict, by };
  }
  const { estimate } = robot;
  const later_ms = estimate ? estimate.stamp_ns / 1e6 - Date.parse(event.time) : 0;
  const isOver = estimate && !estimate.reassembly_open && later_ms > TAKEN_IN_MS;
  return { event, verdict: isOver ? 'none' : 'open', by: null };
}
