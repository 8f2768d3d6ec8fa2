import { describe, expect, it } from 'vitest';
import type { TopView } from '../api/types';
import {
  dots,
  ends,
  inWords,
  line,
  place,
  topViewCsv,
  rows,
  scaleBar,
  vehicle,
  type View,
} from './top-view';

const VIEW: View = { width: 400, height: 200, middle: [10, 5], px_per_m: 20 };

const point = (second: number, lidar: number[], raw: number[], corrected: number[]) => ({
  stamp_ns: (1_760_000_000 + second) * 1e9,
  by_lidar_m: lidar,
  by_raw_steering_m: raw,
  by_corrected_steering_m: corrected,
});

const SEEN: TopView = {
  stamp_ns: 1_760_000_002e9,
  lidar: { x_m: 10, y_m: 5, yaw_rad: Math.PI / 2 },
  lidar_in_base: { x_m: 1, y_m: 0, yaw_rad: 0 },
  lost: false,
  returns_m: [[11, 5]],
  surfaces_m: [[12, 5]],
  trajectory: [point(0, [8, 5], [8, 5], [8, 5]), point(2, [10, 4], [10, 4.3], [10, 4.04])],
  distance_m: 2.2,
};

describe('a top view', () => {
  it('has y upwards and the robot in the middle', () => {
    expect(place(VIEW, [10, 5])).toEqual([200, 100]);
    expect(place(VIEW, [11, 6])).toEqual([220, 80]);
    expect(
      line(VIEW, [
        [10, 5],
        [11, 6],
      ]),
    ).toBe('M200.0 100.0L220.0 80.0');
    // What lies outside is not drawn.
    expect(
      dots(VIEW, [
        [10, 5],
        [100, 5],
      ]),
    ).toBe('M200.0 100.0h0');
  });

  it('draws the vehicle where the LiDAR and its mount say', () => {
    // The LiDAR looks along y of the frame, one metre ahead of the rear axle at (10, 4).
    const nose = vehicle(SEEN, 2)?.[2];
    expect(nose?.[0]).toBeCloseTo(10);
    expect(nose?.[1]).toBeCloseTo(6.6);
    expect(vehicle({ ...SEEN, lidar_in_base: null }, 2)).toBeNull();
  });

  it('has a scale bar of a round length that fits', () => {
    expect(scaleBar(VIEW, 120)).toBe(5);
    expect(scaleBar({ ...VIEW, px_per_m: 150 }, 120)).toBe(0.5);
    expect(scaleBar({ ...VIEW, px_per_m: 8 }, 120)).toBe(10);
  });

  it('says how far each steering ends from the LiDAR', () => {
    expect(ends(SEEN)?.raw_m).toBeCloseTo(0.3);
    expect(ends(SEEN)?.corrected_m).toBeCloseTo(0.04);
    expect(inWords(SEEN)).toBe(
      'Over the last 2 m, raw steering ends 0.30 m from where the LiDAR says, corrected steering 0.04 m.',
    );
    const learning = { ...SEEN, trajectory: [] };
    expect(ends(learning)).toBeNull();
    expect(inWords(learning)).toMatch(/first calibration/);
  });

  it('is a table, the newest first, and a file', () => {
    const [newest, oldest] = rows(SEEN);
    expect(newest).toMatchObject({ before_s: 0, x_m: 10, y_m: 4 });
    expect(oldest).toMatchObject({ before_s: 2, raw_off_m: 0 });
    const lines = topViewCsv(SEEN).trimEnd().split('\r\n');
    expect(lines[0]).toBe('what,time_utc,x_m,y_m');
    expect(lines).toContain('rear_axle_by_raw_steering,2025-10-09T08:53:22.000Z,10,4.3');
    expect(lines.at(-1)).toBe('surface,,12,5');
    expect(lines).toHaveLength(1 + 1 + 6 + 2);
  });
});
