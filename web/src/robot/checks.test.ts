import { describe, expect, it } from 'vitest';
import type { CheckFinding, CheckedStream } from '../api/types';
import { byUrgency, leftOut, verdict } from './checks';

const finding = (check: string, state: CheckFinding['state']): CheckFinding => ({
  check,
  state,
  cause: state === 'wrong' || state === 'unsure' ? `${check}_cause` : null,
  seen: '',
  advice: null,
  after_m: null,
  after_s: null,
  spoils_values: state === 'wrong',
});

const stream: CheckedStream = {
  stream: 'scan',
  topic: 'scan',
  messages: 1000,
  refused: 0,
  first_refusal: null,
  left_out: [],
  rate_hz: 10,
  period_ms: 100,
  age_ms: 5,
  uneven_ms: 0,
  repeated: 0,
  late: 0,
  gaps: 0,
  longest_gap_s: 0,
  frames: ['lidar'],
};

describe('joining checks', () => {
  it('begin with what is wrong, and keep their order otherwise', () => {
    const all = [
      finding('streams', 'ok'),
      finding('scan', 'not_yet'),
      finding('speed', 'wrong'),
      finding('delay', 'unsure'),
      finding('model', 'ok'),
    ];
    const order = byUrgency(all).map(({ check }) => check);
    expect(order).toEqual(['speed', 'delay', 'scan', 'streams', 'model']);
  });

  it('say how they stand', () => {
    const said = (...findings: CheckFinding[]) =>
      verdict({ robot: 'a', way_m: 0, resting: false, streams: [stream], findings });
    expect(said(finding('scan', 'ok'))).toBe('Nothing is wrong.');
    expect(said(finding('scan', 'not_yet'))).toBe('Nothing is wrong so far.');
    expect(said(finding('scan', 'wrong'), finding('speed', 'not_yet'))).toBe('One cause is named.');
    expect(said(finding('scan', 'wrong'), finding('delay', 'unsure'))).toBe('2 causes are named.');
    const nothing = { robot: 'a', way_m: 0, resting: false, streams: [], findings: [] };
    expect(verdict(nothing)).toBe('Nothing has arrived since the checks began.');
  });

  it('say what was left out of a stream, by reason', () => {
    expect(leftOut(stream)).toBe('none');
    const left_out = [
      { reason: 'refused', messages: 120, share: 0.12 },
      { reason: 'mailbox_full', messages: 5, share: 0.005 },
    ];
    expect(leftOut({ ...stream, left_out })).toBe('120 refused (12.0 %), 5 mailbox full (0.5 %)');
  });
});
