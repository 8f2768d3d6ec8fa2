import { describe, expect, it } from 'vitest';
import type { HistorySeries, ParameterStatus, Robot } from '../api/types';
import type { AppliedStep } from '../robot/applied';
import { along, deviationOf, deviations, tolerancesOff } from './deviation';

const values = (lidar_x_m: number) => ({
  steering_offset_rad: 0,
  lidar_x_m,
  lidar_y_m: 0,
  lidar_yaw_rad: 0,
});
const tolerance = { steering_offset_deg: 0.15, lidar_yaw_deg: 0.15, lidar_position_mm: 10 };
/** A week in which the LiDAR is 30 mm from its assumed place. */
const history = {
  time: ['2026-01-01T00:00:00Z', '2026-01-02T00:00:00Z', '2026-01-03T00:00:00Z'],
  series: [
    { parameter: 'lidar_x', mean: [1.03, 1.03, 1.031], status: Array(3).fill('converged') },
  ] as unknown as HistorySeries[],
};
const step = (time: string, generation: number, x: number): AppliedStep => ({
  t_s: Date.parse(time) / 1000,
  generation,
  values: values(x),
});
const rounded = (steps: AppliedStep[], x: number) =>
  deviations(history, steps, values(x), tolerance).map((off) => off && Number(off.toFixed(3)));

describe('the deviation of a week', () => {
  it('is from what was in use then: a new calibration does not make the past flat', () => {
    const steps = [step('2025-12-31T00:00:00Z', 0, 1), step('2026-01-02T12:00:00Z', 1, 1.03)];
    expect(rounded(steps, 1.03)).toEqual([3, 3, 0.1]);
  });

  it('is from what is in use where nothing was ever deployed', () => {
    expect(rounded([], 1)).toEqual([3, 3, 3.1]);
  });

  it('knows no more than the steps do', () => {
    expect(rounded([step('2026-01-02T12:00:00Z', 2, 1.03)], 1.03)).toEqual([null, null, 0.1]);
    expect(rounded([step('2026-01-02T12:00:00Z', 0, 1)], 1)[0]).toBe(3);
  });
});

describe('the deviation of a robot', () => {
  const robot = (
    found: [offset_deg: number, x_m: number, yaw_deg: number],
    statuses: ParameterStatus[] = [],
  ) => {
    const [offset_deg, x_m, yaw_deg] = found;
    const parameter = (value: number, i: number) => ({
      value,
      sigma: 0.001,
      status: statuses[i] ?? 'converged',
    });
    const degree = Math.PI / 180;
    return {
      calibration: { in_use: values(1) },
      estimate: {
        parameters: {
          steering_offset: parameter(offset_deg * degree, 0),
          lidar_x: parameter(x_m, 1),
          lidar_y: parameter(0, 2),
          lidar_yaw: parameter(yaw_deg * degree, 3),
        },
      },
    } as unknown as Robot;
  };

  it('is what the service says', () => {
    const said = { deviation: { tolerances: 2.5, parameter: 'lidar_x' } } as Robot;
    expect(deviationOf(said)).toEqual({ worst: 2.5, name: 'lidar_x' });
    expect(deviationOf({ deviation: null })).toEqual({ worst: null, name: null });
  });

  it('has four signed parts, in tolerances', () => {
    const off = tolerancesOff(robot([-0.3, 1.005, 0.075]), tolerance);
    expect(off.map((one) => Number(one?.toFixed(3)))).toEqual([-2, 0.5, 0, 0.5]);
    expect(tolerancesOff(robot([3, 1.005, 0], ['learning']), tolerance)[0]).toBeNull();
  });

  it('has no parts while the estimate, the values in use or the tolerance are not known', () => {
    const none = [null, null, null, null];
    expect(tolerancesOff(robot([1, 1, 1]), undefined)).toEqual(none);
    const unsaid = { ...robot([1, 1, 1]), calibration: { in_use: null } } as unknown as Robot;
    expect(tolerancesOff(unsaid, tolerance)).toEqual(none);
    const unheard = { calibration: { in_use: values(1) } } as unknown as Robot;
    expect(tolerancesOff(unheard, tolerance)).toEqual(none);
  });

  it('has a scale that ends', () => {
    expect(along(0)).toBe(0);
    expect(along(1)).toBeCloseTo(0.25);
    expect(along(3)).toBeCloseTo(0.5);
    expect(along(15)).toBe(1);
    expect(along(400)).toBe(1);
  });
});
