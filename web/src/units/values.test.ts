import { describe, expect, it } from 'vitest';
import type { Tolerance, Values } from '../api/types';
import { compareBeside, compareValues, difference } from './values';

const RAD = Math.PI / 180;
const tolerance: Tolerance = {
  steering_offset_deg: 0.15,
  lidar_yaw_deg: 0.2,
  lidar_position_mm: 10,
};
const values = (offset: number, x: number, y: number, yaw: number): Values => ({
  steering_offset_rad: offset * RAD,
  lidar_x_m: x,
  lidar_y_m: y,
  lidar_yaw_rad: yaw * RAD,
});

describe('two calibrations', () => {
  it('are compared value by value against the tolerance', () => {
    const before = values(0, 0.434, 0, 0);
    const after = values(0.16, 0.443, -0.011, 0.19);
    const rows = compareValues(before, after, values(0.04, 0.003, 0, 0.1), tolerance);
    expect(rows.map(({ beyond }) => beyond)).toEqual([true, false, true, false]);
    expect(rows[0]?.sigmas).toBeCloseTo(4);
    // Nobody measured y: there is no sigma to count in.
    expect(rows[2]?.sigmas).toBeNull();
  });

  it('say nothing where one is missing', () => {
    const [row] = compareValues(null, values(1, 0, 0, 0), undefined, tolerance);
    expect(row).toMatchObject({ from: null, change: null, beyond: false });
  });

  it('hide nothing that goes along and would change', () => {
    const plain = values(0, 0.4, 0, 0);
    const names = (from: Values | null, to: Values) =>
      compareBeside(from, to, undefined).map(({ name }) => name);
    expect(names(null, plain)).toEqual([]);
    // What a robot has said nothing of is 1 or 0; its wheelbase is anybody's guess.
    const same = { ...plain, speed_scale: 1, steering_gain: 1, time_offset_s: 0 };
    expect(names(null, same)).toEqual([]);
    expect(names(null, { ...same, wheelbase_m: 1.2 })).toEqual(['wheelbase']);
    expect(names({ ...plain, wheelbase_m: 1.2 }, { ...plain, wheelbase_m: 1.2 })).toEqual([]);
    const scaled = { ...plain, speed_scale: 1.012, time_offset_s: -0.05 };
    expect(names(null, scaled)).toEqual(['speed_scale', 'time_offset']);
    // What would no longer be sent is a change too.
    const [gone] = compareBeside(scaled, { ...plain, time_offset_s: -0.05 }, undefined);
    expect(gone).toMatchObject({ name: 'speed_scale', from: 1.012, to: null, change: null });
    const [scale] = compareBeside(null, scaled, { ...plain, speed_scale: 0.003 });
    expect(scale?.sigmas).toBeCloseTo(4);
  });

  it('are as far apart as the short way round says', () => {
    expect(difference('lidar_yaw', 179 * RAD, -179 * RAD)).toBeCloseTo(2 * RAD);
    expect(difference('steering_offset', 1, 3)).toBe(2);
  });
});
