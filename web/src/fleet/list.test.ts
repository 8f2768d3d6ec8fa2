import { describe, expect, it } from 'vitest';
import type { Parameter, Robot, RobotState } from '../api/types';
import { compare, counts, type Filter, filterOf, matches, needs } from './list';
import { BY_URGENCY, robotFace, ROBOT_STATES, STATUSES } from './states';

const parameter = (need: string | null): Parameter => ({
  value: 0,
  sigma: 1,
  unit: 'rad',
  status: need === null ? 'converged' : 'learning',
  needs: need,
});

function robot(id: string, state: RobotState, wanted: (string | null)[] = []): Robot {
  const [offset = null, x = null, y = null, yaw = null] = wanted;
  return {
    id,
    state,
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

const listed = (robots: Robot[], filter: Filter) =>
  robots.filter((robot) => matches(robot, filter)).toSorted(compare);

const every = { state: null, text: '' };

describe('the list of robots', () => {
  it('has the worst first, then ids as people count', () => {
    const robots = [
      robot('a10', 'calibrated'),
      robot('a9', 'calibrated'),
      robot('b', 'learning'),
      robot('c', 'no_data'),
      robot('d', 'unregistered'),
      robot('e', 'changed'),
      robot('f', 'failed'),
    ];
    expect(listed(robots, every).map(({ id }) => id)).toEqual('f e c d b a9 a10'.split(' '));
  });

  it('is filtered by state and by part of an id', () => {
    const robots = [robot('Tugger_1', 'learning'), robot('tugger_2', 'calibrated')];
    expect(listed(robots, { state: 'learning', text: '' })).toHaveLength(1);
    expect(listed(robots, { state: null, text: 'TUGGER' })).toHaveLength(2);
    expect(listed(robots, { state: 'learning', text: '_2' })).toHaveLength(0);
  });

  it('reads its filter from the address', () => {
    expect(filterOf(new URLSearchParams('state=changed&q=%20x'))).toEqual({
      state: 'changed',
      text: 'x',
    });
    expect(filterOf(new URLSearchParams(''))).toEqual(every);
  });

  it('keeps robots in a state that a newer service has, in view and first', () => {
    const strange = robot('z', 'exploded' as RobotState);
    const robots = [robot('a', 'failed'), strange];
    expect(listed(robots, every)[0]).toBe(strange);
    expect(counts(robots)).toEqual([
      ['exploded', 1],
      ['failed', 1],
    ]);
    expect(robotFace('exploded').word).toBe('exploded');
  });

  it('counts states, the worst first', () => {
    const robots = [robot('a', 'calibrated'), robot('b', 'changed'), robot('c', 'calibrated')];
    expect(counts(robots)).toEqual([
      ['changed', 1],
      ['calibrated', 2],
    ]);
  });

  it('names each need once, with what wants it', () => {
    const wanted = needs(robot('a', 'learning', ['drive', 'turn', 'turn', null]));
    expect(wanted).toEqual([
      { need: 'drive', parameters: ['steering_offset'] },
      { need: 'turn', parameters: ['lidar_x', 'lidar_y'] },
    ]);
  });
});

describe('shapes', () => {
  it('tell every state of a robot from every other without colour', () => {
    const shapes = BY_URGENCY.map((state) => ROBOT_STATES[state].shape);
    expect(new Set(shapes).size).toBe(shapes.length);
  });

  it('tell what a parameter does from what it does not', () => {
    const { converged, learning, unobservable, fixed } = STATUSES;
    const shapes = [converged, learning, unobservable, fixed].map(({ shape }) => shape);
    expect(new Set(shapes).size).toBe(shapes.length);
  });
});
