import { describe, expect, it } from 'vitest';
import type { CrossTrackErrors, CrossTrackItem } from '../api/types';
import { beforeAfter, crossTrackCsv, gainOf } from './crosstrack';

const item = (generation: number, bins: number[]): CrossTrackItem => ({
  generation,
  bins,
  count: bins.reduce((a, b) => a + b, 0),
  mean_m: 0,
  rms_m: 0.01,
});
const errors = (items: CrossTrackItem[]): CrossTrackErrors => ({
  bin_width_m: 0.01,
  from_m: -0.05,
  items,
});

describe('cross-track errors', () => {
  it('are compared between the present calibration and the one before', () => {
    const old = item(0, [0, 0, 0, 0, 0, 0, 0, 2, 2, 0]);
    const present = item(1, [0, 0, 0, 0, 6, 2, 0, 0, 0, 0]);
    const found = beforeAfter(errors([old, present]));
    expect(found?.before?.generation).toBe(0);
    expect(found?.bars.map(({ before }) => before)).toEqual([0, 0, 0, 0, 0, 0.5, 0.5, 0]);
    expect(found?.bars.map(({ after }) => after)).toEqual([0, 0, 0.75, 0.25, 0, 0, 0, 0]);
    expect(found?.bars[0]?.from_mm).toBeCloseTo(-30);
  });

  it('are nothing while the robot has reported none', () => {
    expect(beforeAfter(errors([]))).toBeNull();
    expect(beforeAfter(errors([item(0, [0, 0])]))).toBeNull();
    expect(beforeAfter(errors([item(0, [1, 0])]))?.before).toBeNull();
  });

  it('say what the present calibration has done, also where it did harm', () => {
    const of = (before_m: number, now_m: number) =>
      gainOf(
        beforeAfter(
          errors([
            { ...item(0, [1]), rms_m: before_m },
            { ...item(1, [1]), rms_m: now_m },
          ]),
        ),
      );
    expect(of(0.02, 0.005)).toEqual({ before_mm: 20, now_mm: 5, less: 0.75 });
    expect(of(0.01, 0.015)?.less).toBeCloseTo(-0.5);
    expect(gainOf(beforeAfter(errors([item(0, [1])])))).toMatchObject({ less: null });
    expect(gainOf(null)).toBeNull();
  });

  it('go into a CSV file with a column for each calibration', () => {
    const text = crossTrackCsv(errors([item(0, [1, 0]), item(3, [0, 2])]));
    expect(text.split('\r\n').slice(0, 2)).toEqual([
      'from_m,to_m,count_generation_0,count_generation_3',
      '-0.050,-0.040,1,0',
    ]);
  });
});
