import { describe, expect, it } from 'vitest';
import type { HistorySeries } from '../api/types';
import type { AppliedStep } from '../robot/applied';
import { deviations } from './deviation';

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
