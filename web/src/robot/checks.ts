/** Joining checks of a robot, in the words of its page. */

import type { CheckFinding, CheckedStream, Checks, CheckState } from '../api/types';
import type { Face } from '../ui/face';
import { fixed, formatCount } from '../units/format';

/** States, the most urgent first. */
export const STATES: Record<CheckState, Face> = {
  wrong: {
    word: 'Wrong',
    shape: 'cross',
    tone: 'bad',
    meaning: 'The messages contradict the motion of the LiDAR.',
  },
  unsure: {
    word: 'Unsure',
    shape: 'half',
    tone: 'warn',
    meaning: 'What was seen has more than one explanation.',
  },
  not_yet: {
    word: 'Not yet',
    shape: 'ring',
    tone: 'quiet',
    meaning: 'Too little was seen so far.',
  },
  ok: {
    word: 'OK',
    shape: 'check',
    tone: 'good',
    meaning: 'The messages and the motion of the LiDAR go together.',
  },
};

const ORDER = Object.keys(STATES);

/** Returns the findings, the most urgent first. */
export function byUrgency(findings: readonly CheckFinding[]): CheckFinding[] {
  return [...findings].sort((a, b) => ORDER.indexOf(a.state) - ORDER.indexOf(b.state));
}

/** Says in a sentence how the checks stand. */
export function verdict({ findings, streams }: Checks): string {
  const named = findings.filter(({ cause }) => cause != null).length;
  if (named > 0) return named === 1 ? 'One cause is named.' : `${named} causes are named.`;
  if (streams.length === 0) return 'Nothing has arrived since the checks began.';
  const open = findings.filter(({ state }) => state === 'not_yet').length;
  return open > 0 ? 'Nothing is wrong so far.' : 'Nothing is wrong.';
}

/** Says what was not used of a stream, by reason. */
export function leftOut({ left_out }: CheckedStream): string {
  const words = left_out.map(
    ({ reason, messages, share }) =>
      `${formatCount(messages)} ${reason.replaceAll('_', ' ')} (${fixed(100 * share, 1)} %)`,
  );
  return words.join(', ') || 'none';
}
