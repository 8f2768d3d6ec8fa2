import { describe, expect, it } from 'vitest';
import type { RobotEvent } from '../api/types';
import { eventFace, eventMarks, wordsAt, eventText, joined } from './events';

const event: RobotEvent = {
  id: 1,
  robot: 'tugger_01',
  kind: 'calibration_changed',
  time: '2026-11-21T13:00:00Z',
  received: '2026-11-21T13:00:01Z',
  source: 'estimator',
  author: null,
  note: null,
  details: { cause: 'lidar_mount', change: { lidar_yaw: Math.PI / 180, lidar_x: -0.03 } },
};

describe('an event', () => {
  it('says what moved, how far and in which unit', () => {
    expect(eventText(event)).toBe(
      'The LiDAR moved on the vehicle. LiDAR yaw by 1.000°, LiDAR x by \u221230.0\u00a0mm.',
    );
  });

  it('says of a fault that the LiDAR lost its way, and blames no part of the vehicle', () => {
    const told = (cause: string) => eventText({ ...event, kind: 'fault', details: { cause } });
    expect(told('odometry')).toBe('The LiDAR sees too little to know how far the robot has come.');
    expect(told('vehicle')).toContain('pushed, towed or lifted');
  });

  it('is never in amber, which asks a person to act', () => {
    for (const kind of ['applied', 'reassembled', 'rolled_back', 'maintenance']) {
      expect(eventFace(kind).tone).toBe('ink');
    }
  });

  it('keeps the words of a person', () => {
    expect(eventText({ ...event, details: null, note: 'New bracket' })).toBe('New bracket');
  });

  it('is shown by its kind when this page does not know it', () => {
    expect(eventFace('moved_house').word).toBe('moved house');
  });

  it('marks its time on the charts', () => {
    expect(eventMarks([event])).toEqual([
      {
        t_s: Date.parse(event.time) / 1000,
        tone: 'bad',
        word: 'Calibration changed',
        text: eventText(event),
      },
    ]);
  });

  it('is named by the cursor that is near, once', () => {
    const marks = eventMarks([event, { ...event, kind: 'applied' }, event]);
    const at_s = marks[0]?.t_s ?? 0;
    expect(wordsAt(marks, at_s + 4, 5)).toEqual(['Calibration changed', 'Applied by the robot']);
    expect(wordsAt(marks, at_s + 6, 5)).toEqual([]);
  });
});

describe('events of the stream', () => {
  const event = (kind: RobotEvent['kind'], more: Partial<RobotEvent> = {}): RobotEvent => ({
    kind,
    robot: 'agv_1',
    source: 'estimator',
    time: '2026-01-01T12:00:00Z',
    received: '2026-01-01T12:00:01Z',
    ...more,
  });

  it('are shown before their rows are written, once, and complete', () => {
    const before = event('fault', { id: 3, time: '2026-01-01T11:00:00Z' });
    const heard = event('calibration_changed', { details: { cause: 'lidar_mount', change: {} } });
    expect(joined([before], [heard])).toEqual([heard, before]);
    const sized = { ...heard, details: { cause: 'lidar_mount', change: { lidar_yaw: 0.02 } } };
    expect(joined([heard, before], [sized])).toEqual([sized, before]);
    const row = { ...heard, id: 4, time: '2026-01-01T12:00:00.000000000Z' };
    expect(joined([row, before], [sized])).toEqual([{ ...sized, id: 4 }, before]);
  });

  it('of two people are two', () => {
    const one = event('reassembled', { source: 'person', note: 'bracket' });
    const other = { ...one, note: 'wheel' };
    expect(joined([one], [other])).toEqual([other, one]);
  });

  it('say what was found, and no cause of what has none', () => {
    const confirmed = event('calibration_confirmed', { details: { cause: 'unknown', change: {} } });
    expect(eventText(confirmed)).toBe('It agrees with the calibration of before.');
  });
});
