/** What came of the latest reassembly: the same calibration as before, another, or not known yet. */

import type { Robot, RobotEvent } from '../api/types';
import type { Face } from '../ui/face';

/** The estimator has taken a report in after this long, and says `learning`. */
const TAKEN_IN_MS = 10_000;

export type Verdict = 'same' | 'changed' | 'open' | 'nothing_stored';

export interface Reassembly {
  /** What was reported. */
  event: RobotEvent;
  verdict: Verdict;
  /** The estimator's event that says so. */
  by: RobotEvent | null;
}

export const VERDICTS: Record<Verdict, Face> = {
  same: {
    word: 'Unchanged',
    shape: 'check',
    tone: 'good',
    meaning: 'What was learnt since agrees with the stored calibration within its uncertainty.',
  },
  changed: {
    word: 'Changed',
    shape: 'diamond',
    tone: 'bad',
    meaning: 'What was learnt since differs significantly from the stored calibration.',
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
    meaning: 'No finished calibration was stored. The current one was learned from scratch.',
  },
};

/** The latest reassembly among a robot's events, the newest first; null when there was none. */
export function reassemblyOf(events: readonly RobotEvent[], robot: Robot): Reassembly | null {
  const at = events.findIndex(({ kind }) => kind === 'reassembled');
  const event = events[at];
  if (!event) return null;
  const by = events.slice(0, at).findLast(({ kind, source }) => {
    return (
      source === 'estimator' && (kind === 'calibration_confirmed' || kind === 'calibration_changed')
    );
  });
  if (by) return { event, verdict: by.kind === 'calibration_confirmed' ? 'same' : 'changed', by };
  const heard_ms = Date.parse(robot.last_seen ?? event.received) - Date.parse(event.received);
  const found = robot.state === 'calibrated' && heard_ms > TAKEN_IN_MS;
  return { event, verdict: found ? 'nothing_stored' : 'open', by: null };
}
