import { describe, expect, it } from 'vitest';
import type { EventKind, Robot, RobotEvent } from '../api/types';
import { reassemblyOf } from './reassembly';

const event = (id: number, kind: EventKind, source: RobotEvent['source']): RobotEvent => ({
  id,
  kind,
  source,
  robot: 'agv_1',
  time: '2026-01-01T12:00:00Z',
  received: '2026-01-01T12:00:00Z',
});
const robot = (state: Robot['state'], seconds: number) =>
  ({ state, last_seen: new Date(Date.UTC(2026, 0, 1, 12, 0, seconds)).toISOString() }) as Robot;

describe('a reassembly', () => {
  const reported = event(5, 'reassembled', 'person');
  const before = event(4, 'calibration_changed', 'estimator');

  it('is not there when nobody reported one', () => {
    expect(reassemblyOf([before], robot('learning', 0))).toBeNull();
  });

  it('is open until the estimator has said something, and what it said first counts', () => {
    expect(reassemblyOf([reported, before], robot('learning', 60))?.verdict).toBe('open');
    const same = event(6, 'calibration_confirmed', 'estimator');
    const later = event(7, 'calibration_changed', 'estimator');
    const found = reassemblyOf([later, same, reported, before], robot('calibrated', 60));
    expect(found).toMatchObject({ verdict: 'same', by: { id: 6 } });
    expect(reassemblyOf([later, reported], robot('learning', 60))?.verdict).toBe('changed');
    // A new report begins from scratch.
    const again = event(8, 'reassembled', 'robot');
    expect(reassemblyOf([again, later, reported], robot('learning', 60))).toMatchObject({
      verdict: 'open',
      event: { id: 8 },
    });
  });

  it('had nothing to be compared with when all is found and nothing was said', () => {
    expect(reassemblyOf([reported], robot('calibrated', 60))?.verdict).toBe('nothing_stored');
    // The estimator has not taken it in yet.
    expect(reassemblyOf([reported], robot('calibrated', 1))?.verdict).toBe('open');
  });
});
