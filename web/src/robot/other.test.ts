import { describe, expect, it } from 'vitest';
import { keyOf, otherAt, otherLine, withOf, wordOf } from './other';
import type { Series } from './series';

const of = (query: string) => withOf(new URLSearchParams(query), 'tugger_01');

describe('what stands beside a history', () => {
  it('is named by the address', () => {
    expect(of('with=tugger_02')).toEqual({ kind: 'robot', id: 'tugger_02' });
    const day = of('with=-1d');
    expect(day).toEqual({ kind: 'earlier', key: '-1d', by_s: 86_400 });
    expect([keyOf(day), keyOf(null)]).toEqual(['-1d', '']);
    expect(day && wordOf(day)).toBe('a day before');
  });

  it('is nothing without a name, and never the robot itself', () => {
    for (const query of ['', 'with=', 'with=tugger_01', 'with=-9y']) expect(of(query)).toBeNull();
  });
});

describe('its line', () => {
  const series: Series = {
    t_s: [100, 101],
    mean: [0.1, 0.2],
    min: [0.1, 0.2],
    max: [0.1, 0.2],
    sigma: [0.01, 0.01],
    status: ['converged', 'converged'],
  };
  const line = otherLine(series, 'lidar_x', { bucket_s: 1, by_s: 3600, word: 'an hour before' });

  it('is in shown units, and later by as much as it is from before', () => {
    expect(line.points).toEqual([
      { t_s: 3700, value: 100 },
      { t_s: 3701, value: 200 },
    ]);
  });

  it('has the value of a time near its points alone', () => {
    expect(otherAt(line, 'lidar_x', 3701.4, 2)).toBeCloseTo(0.2);
    expect(otherAt(line, 'lidar_x', 3800, 2)).toBeNull();
  });
});
