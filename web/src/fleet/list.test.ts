import { describe, expect, it } from 'vitest';
import openapi from '../../openapi.json';
import type { Parameter, Robot, RobotState, Standing } from '../api/types';
import { faceOf } from '../ui/face';
import type { Connection } from './connection';
import { counts, type Filter, filterOf, inView, type Listed, matches, needs } from './list';
import { BY_URGENCY, needsPerson, STANDINGS } from './standing';
import { STATUSES } from './states';

const parameter = (need: string | null): Parameter => ({
  value: 0,
  sigma: 1,
  unit: 'rad',
  status: need === null ? 'converged' : 'learning',
  needs: need,
});

function robot(state: RobotState, wanted: (string | null)[] = []): Robot {
  const [offset = null, x = null, y = null, yaw = null] = wanted;
  return {
    state,
    calibration: { in_sync: true, sync: 'in_sync', verification_failed: false },
    estimate: {
      parameters: {
        steering_offset: parameter(offset),
        lidar_x: parameter(x),
        lidar_y: parameter(y),
        lidar_yaw: parameter(yaw),
        speed_scale: parameter('not asked here'),
      },
    },
  } as Robot;
}

const entry = (
  id: string,
  standing: Standing,
  connection: Connection = 'online',
  maintained = connection === 'maintenance',
): Listed => ({ id, standing, connection, maintained });

const byId = (robots: Listed[]) => new Map(robots.map((robot) => [robot.id, robot]));
const listed = (robots: Listed[], filter: Filter) =>
  inView(byId(robots), null, '').filter((robot) => matches(robot, filter));

const every: Filter = { state: null, connection: null, text: '', sort: '' };

describe('the list of robots', () => {
  it('has the worst first, then ids as people count', () => {
    const robots = [
      entry('a10', 'calibrated'),
      entry('a9', 'calibrated'),
      entry('b', 'learning'),
      entry('c', 'no_data'),
      entry('d', 'unregistered'),
      entry('e', 'drift'),
      entry('f', 'estimator_failed'),
    ];
    expect(listed(robots, every).map(({ id }) => id)).toEqual('e f d c b a9 a10'.split(' '));
  });

  it('has robots in maintenance among those, also while they drive', () => {
    const robots = [
      entry('driving', 'calibrated', 'online', true),
      entry('off', 'learning', 'maintenance'),
      entry('other', 'calibrated'),
    ];
    const heard = (connection: string) =>
      listed(robots, { ...every, connection }).map(({ id }) => id);
    expect(heard('maintenance')).toEqual(['off', 'driving']);
    expect(heard('online')).toEqual(['driving', 'other']);
  });

  it('is filtered by state', () => {
    const robots = [entry('Tugger_1', 'learning'), entry('tugger_2', 'calibrated')];
    expect(listed(robots, { ...every, state: 'learning' })).toHaveLength(1);
  });

  it('has the robots and the order of a view that the service has evaluated', () => {
    const robots = byId(['a', 'b', 'c'].map((id) => entry(id, id === 'b' ? 'drift' : 'learning')));
    const ids = (of: string[], sort: string) => inView(robots, of, sort).map(({ id }) => id);
    expect(ids(['c', 'a', 'gone'], '-deviation')).toEqual(['c', 'a']);
    expect(ids(['c', 'b', 'a'], '')).toEqual(['b', 'a', 'c']);
    expect(ids([], '')).toEqual([]);
  });

  it('has silent robots before those that need nobody, and after those that need somebody', () => {
    const robots = [
      entry('fine', 'calibrated'),
      entry('parked', 'calibrated', 'maintenance'),
      entry('silent', 'calibrated', 'silent'),
      entry('waiting', 'awaiting_approval', 'silent'),
    ];
    const ids = listed(robots, every).map(({ id }) => id);
    expect(ids).toEqual(['waiting', 'silent', 'fine', 'parked']);
  });

  it('is filtered by whether robots are heard, apart from how they stand', () => {
    const robots = [entry('a', 'calibrated', 'silent'), entry('b', 'calibrated')];
    expect(listed(robots, { ...every, connection: 'silent' }).map(({ id }) => id)).toEqual(['a']);
  });

  it('reads its filter from the address', () => {
    expect(
      filterOf(new URLSearchParams('state=changed&connection=silent&q=%20x&sort=-age')),
    ).toEqual({
      state: 'changed',
      connection: 'silent',
      text: 'x',
      sort: '-age',
    });
    expect(filterOf(new URLSearchParams(''))).toEqual(every);
  });

  it('keeps robots in a state that a newer service has, in view and first', () => {
    const strange = entry('z', 'exploded' as Standing);
    const robots = [entry('a', 'estimator_failed'), strange];
    expect(listed(robots, every)[0]).toBe(strange);
    expect(counts(robots)).toEqual([
      ['exploded', 1],
      ['estimator_failed', 1],
    ]);
    expect(faceOf(STANDINGS, 'exploded').word).toBe('exploded');
  });

  it('counts standings, the worst first', () => {
    const robots = [entry('a', 'calibrated'), entry('b', 'drift'), entry('c', 'calibrated')];
    expect(counts(robots)).toEqual([
      ['drift', 1],
      ['calibrated', 2],
    ]);
  });

  it('names each need once, with what wants it', () => {
    const wanted = needs(robot('learning', ['drive', 'turn', 'turn', null]));
    expect(wanted).toEqual([
      { need: 'drive', parameters: ['steering_offset'] },
      { need: 'turn', parameters: ['lidar_x', 'lidar_y'] },
    ]);
  });
});

describe('how a robot stands', () => {
  it('has the order of the service, the most urgent first', () => {
    expect(BY_URGENCY).toEqual(openapi.components.schemas.Standing.enum);
  });

  it('asks for a person where somebody has to act', () => {
    const asking: Standing[] = ['rollback_failed', 'drift', 'verification_failed'];
    asking.push('awaiting_approval', 'uncalibrated');
    expect(asking.filter(needsPerson)).toEqual(asking);
    expect(
      (['deploying', 'no_data', 'learning', 'calibrated'] as const).filter(needsPerson),
    ).toEqual([]);
  });
});

describe('shapes', () => {
  it('tell every standing of a robot from every other without colour', () => {
    const shapes = BY_URGENCY.map((one) => STANDINGS[one].shape);
    expect(new Set(shapes).size).toBe(shapes.length);
  });

  it('tell what a parameter does from what it does not', () => {
    const { converged, learning, unobservable, fixed } = STATUSES;
    const shapes = [converged, learning, unobservable, fixed].map(({ shape }) => shape);
    expect(new Set(shapes).size).toBe(shapes.length);
  });
});
