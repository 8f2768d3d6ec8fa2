import { describe, expect, it } from 'vitest';
import type { EventKind, Parameter, Robot, RobotEvent } from '../api/types';
import { reassemblyOf } from '../robot/reassembly';
import {
  askedOf,
  guideOf,
  isDone,
  knownOf,
  type Manoeuvre,
  mayDrive,
  noteOf,
  stageFace,
  usesEstimate,
} from './guide';

const NOW_MS = Date.UTC(2026, 0, 1, 12, 10);

const parameter = (status: Parameter['status'], needs: string | null = null): Parameter => ({
  value: 0,
  sigma: 0.01,
  unit: 'm',
  status,
  needs,
});

const robot = (reassembly_open: boolean, more: Partial<Robot> = {}) =>
  ({
    id: 'agv_1',
    state: 'learning',
    standing: 'learning',
    calibration: { in_sync: true, sync: 'in_sync', verification_failed: false },
    estimate: {
      reassembly_open,
      stamp_ns: (NOW_MS - 60_000) * 1e6,
      parameters: {
        steering_offset: parameter('converged'),
        lidar_x: parameter('learning', 'a quarter turn to the right'),
        lidar_y: parameter('learning', 'a quarter turn to the right'),
        lidar_yaw: parameter('learning', 'straight ahead'),
      },
    },
    ...more,
  }) as unknown as Robot;

const event = (kind: EventKind, minute: number): RobotEvent => ({
  id: minute,
  kind,
  source: kind === 'reassembled' ? 'person' : 'estimator',
  robot: 'agv_1',
  time: new Date(Date.UTC(2026, 0, 1, 12, minute)).toISOString(),
  received: new Date(Date.UTC(2026, 0, 1, 12, minute)).toISOString(),
});

/** The guide of a robot with these events, the newest first. */
const guide = (
  of: Robot,
  events: RobotEvent[] = [],
  { now_ms = NOW_MS, connection = 'online' as 'online' | 'silent' } = {},
) =>
  guideOf(
    { robot: of, standing: of.standing, warnings: [] },
    connection,
    reassemblyOf(events, of),
    now_ms,
  );

describe('the guide', () => {
  it('asks what was done while nothing is reported', () => {
    expect(guide(robot(false))).toMatchObject({ stage: 'ask', obstacle: null });
    expect(mayDrive(guide(robot(false)), true)).toBe('Report first');
  });

  it('has the robot driven from the report to the verdict, and gives none of its own', () => {
    const reported = [event('reassembled', 5)];
    expect(guide(robot(true), reported).stage).toBe('drive');
    // The report is known before the estimate that takes it into account.
    const before = robot(false);
    if (before.estimate) before.estimate.stamp_ns = Date.UTC(2026, 0, 1, 12, 5) * 1e6;
    expect(guide(before, reported).stage).toBe('drive');
    // All four may be known: the verdict is the service's alone.
    const known = robot(true);
    if (known.estimate) known.estimate.parameters.lidar_x = parameter('converged');
    expect(stageFace(guide(known, reported)).word).toBe('Not known yet');
  });

  it('gives no verdict of values that a joining check says cannot be right', () => {
    const events = [event('calibration_confirmed', 8), event('reassembled', 5)];
    const seen = { robot: robot(false), standing: 'drift' as const, warnings: [] };
    const reassembly = reassemblyOf(events, seen.robot);
    expect(guideOf(seen, 'online', reassembly, NOW_MS).stage).toBe('same');
    const warnings = [{ kind: 'joining_check' as const, text: 'The steering has the wrong sign.' }];
    const checked = guideOf({ ...seen, warnings }, 'online', reassembly, NOW_MS);
    // A cause that is unsure leaves the values as they are.
    expect(checked.stage).toBe('same');
    const { steering_offset } = seen.robot.estimate?.parameters ?? {};
    if (steering_offset) steering_offset.status = 'learning';
    const spoiled = guideOf({ ...seen, warnings }, 'online', reassembly, NOW_MS);
    expect(spoiled.stage).toBe('blocked');
    expect(spoiled.obstacle?.standing).toBe('fault');
  });

  it('takes back that nothing has changed when something changes afterwards', () => {
    const events = [event('calibration_confirmed', 8), event('reassembled', 5)];
    expect(guide(robot(false, { state: 'changed' }), events).stage).toBe('changed');
  });

  it('says that there is no verdict where the estimator went on without one', () => {
    const found = guide(robot(false), [event('reassembled', 5)]);
    expect(found.stage).toBe('ask');
    expect(stageFace(found).word).toBe('No verdict');
    expect(stageFace(guide(robot(false))).word).toBe('Nothing reported');
  });

  it('ends with the verdict of the service', () => {
    const ends: [EventKind, string][] = [
      ['calibration_confirmed', 'same'],
      ['calibration_changed', 'changed'],
      ['calibration_learned', 'learned'],
    ];
    for (const [kind, stage] of ends) {
      expect(guide(robot(false), [event(kind, 7), event('reassembled', 5)]).stage).toBe(stage);
    }
  });

  it('asks again an hour after a verdict, which is that of other work by then', () => {
    const events = [event('calibration_confirmed', 7), event('reassembled', 5)];
    const later = { now_ms: NOW_MS + 3_600_000 };
    expect(guide(robot(false), events, later)).toMatchObject({
      stage: 'ask',
      reassembly: { verdict: 'same' },
    });
  });

  it('names what stands in the way, and lets work on a silent robot be reported', () => {
    const reported = [event('reassembled', 5)];
    const silent = { connection: 'silent' as const };
    expect(guide(robot(true), reported, silent)).toMatchObject({
      stage: 'blocked',
      obstacle: { standing: 'no_data' },
    });
    expect(guide(robot(false), [], silent).stage).toBe('ask');
    const confirmed = [event('calibration_confirmed', 7), ...reported];
    expect(guide(robot(false), confirmed, silent).stage).toBe('same');
    // What was learnt of two senders is discarded, also after a verdict.
    const two = robot(false, { standing: 'two_senders' });
    expect(guide(two, confirmed).stage).toBe('blocked');
    const failed = robot(true, { state: 'failed' });
    expect(stageFace(guide(failed, reported)).meaning).toContain('stopped');
    const stop = robot(false, { standing: 'rollback_failed' });
    expect(mayDrive(guide(stop), true)).toBe('No, stop it');
  });

  it('has a changed robot driven by hand until it is known to use its new values', () => {
    const events = [event('calibration_changed', 7), event('reassembled', 5)];
    expect(mayDrive(guide(robot(false), events), false)).toBe('By hand only');
    expect(mayDrive(guide(robot(false), events), true)).toBe('Yes');
    // One that has not said what it uses is not known to.
    expect(usesEstimate(robot(false))).toBe(false);
    const off = (tolerances: number) =>
      robot(false, { deviation: { tolerances, parameter: 'steering_offset' } });
    expect(usesEstimate(off(1))).toBe(true);
    expect(usesEstimate(off(3.8))).toBe(false);
  });

  it('is not done while a changed robot has something to learn, and is when it is unchanged', () => {
    const done = (kind: EventKind, asked = askedOf(robot(false), []), uses = true) =>
      isDone(
        guide(robot(false), [event(kind, 7), event('reassembled', 5)]),
        robot(false),
        asked,
        uses,
      );
    expect(done('calibration_changed')).toBe('No, 1 of 4 known');
    expect(done('calibration_confirmed')).toBe('Yes');
    expect(done('calibration_changed', null)).toBe('Yes');
    expect(done('calibration_changed', null, false)).toBe('With driving, yes');
  });
});

describe('what is asked next', () => {
  const manoeuvre = (instruction: string) =>
    ({ instruction, uncertainty_taken: 1, information_bits: 1 }) as Manoeuvre;

  it('is the first need, with its manoeuvre', () => {
    const ranked = ['a figure-eight', 'straight ahead', 'a quarter turn to the right'];
    expect(askedOf(robot(true), ranked.map(manoeuvre))).toMatchObject({
      text: 'a quarter turn to the right',
      manoeuvre: { instruction: 'a quarter turn to the right' },
    });
  });

  it('is in the words of the service where no manoeuvre is that', () => {
    expect(askedOf(robot(true), [manoeuvre('a figure-eight')])).toMatchObject({
      text: 'a quarter turn to the right',
      manoeuvre: null,
    });
  });

  it('is nothing once nothing is missing', () => {
    const { estimate } = robot(true);
    const known = { ...robot(true), estimate: { ...estimate, parameters: {} } };
    for (const name of ['steering_offset', 'lidar_x', 'lidar_y', 'lidar_yaw'] as const) {
      Object.assign(known.estimate.parameters, { [name]: parameter('converged') });
    }
    expect(askedOf(known as Robot, [manoeuvre('a figure-eight')])).toBeNull();
    expect(knownOf(known as Robot)).toEqual({ known: 4, of: 4 });
    expect(knownOf(robot(true))).toEqual({ known: 1, of: 4 });
  });
});

describe('a report', () => {
  it('names the part, and other work in words', () => {
    expect(noteOf(null, 'knocked')).toBeNull();
    expect(noteOf('Bracket', ' ')).toBe('Bracket');
    expect(noteOf('LiDAR', 'cleaned ')).toBe('LiDAR: cleaned');
    expect(noteOf('Other', '')).toBeNull();
    expect(noteOf('Other', 'hit a rack')).toBe('hit a rack');
  });
});
