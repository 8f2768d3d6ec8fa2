import { describe, expect, it } from 'vitest';
import type { Robot, RobotRow } from '../api/types';
import { topicsOf, withRow } from './fleet.svelte';

const BASE = ['alerts', 'approvals', 'deployments'];

describe('the topics of a page', () => {
  it('are what it shows and what every page shows', () => {
    expect(topicsOf('fleet', undefined)).toEqual(['fleet', ...BASE]);
    expect(topicsOf('robot', 'a')).toEqual(['robot:a', ...BASE]);
    expect(topicsOf('proposal', undefined)).toEqual(BASE);
    expect(topicsOf('settings', undefined)).toEqual(BASE);
  });
});

describe('a lean row', () => {
  const parameter = (value: number) => ({ value, sigma: 1, status: 'learning', needs: 'a turn' });
  const robot = {
    id: 'a',
    verification_distance_m: 10,
    estimate: {
      distance_m: 100,
      parameters: {
        steering_offset: parameter(0),
        lidar_x: parameter(0),
        lidar_y: parameter(0),
        lidar_yaw: parameter(0),
        speed_scale: parameter(1),
      },
    },
  } as unknown as Robot;
  const row: RobotRow = {
    robot: 'a',
    standing: 'awaiting_approval',
    distance_m: 103,
    values: [0.01, 0.4, 0.02, 0.03],
    sigmas: [0.1, 0.2, 0.3, 0.4],
    status: ['converged', 'converged', 'learning', 'converged'],
    needs: [null, null, 'a left turn', null],
  };

  it('replaces what the list shows and nothing else', () => {
    const { estimate, standing, verification_distance_m } = withRow(robot, row) ?? {};
    expect(standing).toBe('awaiting_approval');
    expect(estimate?.parameters.lidar_x).toMatchObject({ value: 0.4, sigma: 0.2, needs: null });
    expect(estimate?.parameters.lidar_y.needs).toBe('a left turn');
    expect(estimate?.parameters.speed_scale.value).toBe(1);
    expect(verification_distance_m).toBe(13);
  });

  it('is not enough of a robot without an estimate', () => {
    expect(withRow({ ...robot, estimate: null }, row)).toBeUndefined();
  });
});
