import { describe, expect, it } from 'vitest';
import type { Consistency, Innovation } from '../api/types';
import {
  continued,
  errorsOverExpected,
  fitSentence,
  innovationPoints,
  nisOf,
  nisPoints,
  pointColumns,
  pointRange,
  pointsCsv,
} from './consistency';
import sentences from './fit-sentences.json';

const consistency = (
  nis_mean: number,
  fit: 'explained' | 'rough' | 'unexplained' | null,
): Consistency => ({
  nis_mean,
  nis_dof: 3,
  samples: 200,
  nis_range: [2.67, 3.35],
  fit,
});

describe('whether the model explains the data', () => {
  it('is said in a sentence, with the size of the errors', () => {
    expect(errorsOverExpected(consistency(12, 'rough'))).toBe(2);
    const cases = sentences as { consistency: Consistency; sentence: string }[];
    for (const { consistency, sentence } of cases) expect(fitSentence(consistency)).toBe(sentence);
  });
});

describe('NIS over time', () => {
  const answer = {
    bucket_s: 1,
    time: ['1970-01-01T00:00:10Z', '1970-01-01T00:00:11Z', '1970-01-01T00:00:30Z'],
    count: [1, 1, 1],
    nis: [1, null, 4],
  };

  it('has the times that have one, and its range', () => {
    const points = nisPoints(nisOf(answer), [2.67, 3.35]);
    expect(points.t_s).toEqual([10, 30]);
    expect([points.value, points.low]).toEqual([
      [1, 4],
      [2.67, 2.67],
    ]);
  });

  it('breaks where data are missing', () => {
    const columns = pointColumns(nisPoints(nisOf(answer), null), 1);
    expect(columns[0]).toHaveLength(3);
    expect(columns[5]).toEqual([1, null, 4]);
    expect(columns[1]).toEqual([null, null, null]);
  });

  it('has room for its range on a logarithmic axis, which has no zero', () => {
    const points = nisPoints({ t_s: [1, 2], nis: [0, 30] }, [2, 4]);
    const [low, high] = pointRange(points, true);
    expect(low).toBeGreaterThan(0);
    expect(low).toBeLessThan(2);
    expect(high).toBeGreaterThan(30);
  });
});

describe('innovations', () => {
  const innovation = (s: number, value: number): Innovation => ({
    stamp_ns: s * 1e9,
    residual: [value, 0, 0],
    sigma: [0.002, 0.001, 0.001],
  });

  it('are in millimetres with two sigmas to each side, within the time shown', () => {
    const points = innovationPoints([innovation(1, 0.01), innovation(9, 0.02)], 0, [0, 5]);
    expect(points).toEqual({ t_s: [1], value: [10], low: [-4], high: [4] });
  });

  it('begin again where the clock went back, and keep no more than the service', () => {
    const at = (...times: number[]) =>
      times
        .map((s) => innovation(s, 0))
        .reduce<readonly Innovation[]>((kept, next) => continued(kept, next, 3), [])
        .map(({ stamp_ns }) => stamp_ns / 1e9);
    expect(at(1, 2, 2, 3, 4)).toEqual([2, 3, 4]);
    expect(at(1, 2, 3, 1, 2)).toEqual([1, 2]);
  });

  it('are in SI units in a file', () => {
    const points = innovationPoints([innovation(1, 0.01)], 0, [0, 5]);
    const [head, first] = pointsCsv(points, {
      name: 'innovation_forwards',
      unit: 'm',
      factor: 1000,
    }).split('\r\n');
    expect(head).toBe(
      'time_utc,innovation_forwards_m,innovation_forwards_low_m,innovation_forwards_high_m',
    );
    expect(first).toBe('1970-01-01T00:00:01.000Z,0.01,-0.004,0.004');
  });
});
