import { describe, expect, it } from 'vitest';
import type { Deployment, RobotEvent, Shadow, Values } from '../api/types';
import { appliedAt, appliedSteps, seenValues, stepsOf } from './applied';

const values = (x: number): Values => ({
  steering_offset_rad: 0,
  lidar_x_m: x,
  lidar_y_m: 0,
  lidar_yaw_rad: 0,
});
const at = (second: number) => new Date(second * 1000).toISOString();
const use = (generation: number, second: number, x: number) => ({
  generation,
  since: at(second),
  values: values(x),
});

describe('what was applied', () => {
  const shadow = { in_use: use(3, 300, 0.3), before: null } as unknown as Shadow;
  const applied = (second: number, generation: number, x: number) =>
    ({
      kind: 'applied',
      time: at(second),
      details: { generation, values: values(x) },
    }) as unknown as RobotEvent;
  const deployment = { base: use(0, 10, 0.1) } as unknown as Deployment;

  it('is put together from every record, each generation once', () => {
    const events = [applied(300, 3, 0.3), applied(100, 1, 0.2)];
    const steps = stepsOf(appliedSteps(shadow, events, [deployment, deployment]), 'lidar_x');
    expect(steps).toEqual([
      { t_s: 10, value: 0.1 },
      { t_s: 100, value: 0.2 },
      { t_s: 300, value: 0.3 },
    ]);
    expect(appliedAt(steps, 5)).toBeNull();
    expect(appliedAt(steps, 100)).toBe(0.2);
    expect(appliedAt(steps, 299)).toBe(0.2);
  });

  it('is in a chart as far as the chart reaches', () => {
    const steps = stepsOf(appliedSteps(shadow, [], [deployment]), 'lidar_x');
    expect(seenValues(steps, 50, 200)).toEqual([0.1]);
    expect(seenValues(steps, 50, 400)).toEqual([0.1, 0.3]);
    expect(seenValues(steps, 0, 5)).toEqual([]);
  });
});
