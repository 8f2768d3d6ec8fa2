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
const robot = (reassembly_open: boolean, seconds: number) =>
  ({
    state: 'calibrated',
    last_seen: '2026-01-01T13:00:00Z',
    estimate: { reassembly_open, stamp_ns: Date.UTC(2026, 0, 1, 12, 0, seconds) * 1e6 },
  }) as Robot;

describe('a reassembly', () => {
  const reported = event(5, 'reassembled', 'person');
  const before = event(4, 'calibration_changed', 'estimator');

  it('is not there when nobody reported one', () => {
    expect(reassemblyOf([before], robot(true, 0))).toBeNull();
  });

  it('is open until the estimator has said something, and what it said first counts', () => {
    expect(reassemblyOf([reported, before], robot(true, 60))?.verdict).toBe('open');
    const same = event(6, 'calibration_confirmed', 'estimator');
    const later = event(7, 'calibration_changed', 'estimator');
    const found = reassemblyOf([later, same, reported, before], robot(false, 60));
    expect(found).toMatchObject({ verdict: 'same', by: { id: 6 } });
    expect(reassemblyOf([later, reported], robot(true, 60))?.verdict).toBe('changed');
    // A new report begins from scratch.
    const again = event(8, 'reassembled', 'robot');
    expect(reassemblyOf([again, later, reported], robot(true, 60))).toMatchObject({
      verdict: 'open',
      event: { id: 8 },
    });
  });

  it('had nothing to be compared with when the estimator says so, and only then', () => {
    const learned = event(6, 'calibration_learned', 'estimator');
    const found = reassemblyOf([learned, reported], robot(false, 60));
    expect(found).toMatchObject({ verdict: 'nothing_stored', by: { id: 6 } });
    // Silence is no verdict, however long it lasts and whatever the robot is called.
    expect(reassemblyOf([reported], robot(true, 3600))?.verdict).toBe('open');
    expect(reassemblyOf([reported], { ...robot(true, 0), estimate: null })?.verdict).toBe('open');
  });

  it('has no verdict when the estimator went on without one', () => {
    // The estimate on the page may be from before the report.
    expect(reassemblyOf([reported], robot(false, 1))?.verdict).toBe('open');
    expect(reassemblyOf([reported], robot(false, 60))?.verdict).toBe('none');
  });
});
