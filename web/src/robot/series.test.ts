import { describe, expect, it } from 'vitest';
import {
  append,
  axisRange,
  columns,
  csv,
  isolated,
  lonePlace,
  nearest,
  type Series,
  allSeries,
  unknownStretches,
} from './series';

function series(times: number[], means: number[], sigma = 0.001): Series {
  return {
    t_s: [...times],
    mean: [...means],
    min: [...means],
    max: [...means],
    sigma: means.map(() => sigma),
    status: means.map(() => 'learning' as const),
  };
}

describe('columns of a chart', () => {
  it('are in shown units, with two sigmas to each side', () => {
    const [t, top, bottom, high, low, mean] = columns(series([1, 2], [0.1, 0.2]), 'lidar_x', 1);
    expect(t).toEqual([1, 2]);
    expect(mean).toEqual([100, 200]);
    expect(top[0]).toBeCloseTo(102);
    expect(bottom[0]).toBeCloseTo(98);
    expect([high, low]).toEqual([
      [100, 200],
      [100, 200],
    ]);
  });

  it('break where data are missing, and only there', () => {
    const gap = columns(series([1, 2, 12, 13], [1, 1, 1, 1]), 'lidar_x', 1);
    expect(gap[0]).toEqual([1, 2, 4, 12, 13]);
    expect(gap[5]).toEqual([1000, 1000, null, 1000, 1000]);
    expect(columns(series([0, 60, 120], [1, 1, 1]), 'lidar_x', 60)[0]).toHaveLength(3);
  });
});

describe('an unobservable value', () => {
  it('is only what was assumed: nothing of it is drawn, and it has no say in the axis', () => {
    const unknown = series([0, 1], [0, 0.434], 0.0005);
    unknown.status[0] = 'unobservable';
    unknown.sigma[0] = 1;
    const data = columns(unknown, 'lidar_x', 1);
    expect(data[5]).toEqual([null, 434]);
    expect(data.map((column) => column[0])).toEqual([0, null, null, null, null, null]);
    expect(unknownStretches(unknown)).toEqual([[0, 0]]);
    expect(axisRange(data, 4, 'all')[0]).toBeGreaterThan(400);
    unknown.status[1] = 'unobservable';
    expect(axisRange(columns(unknown, 'lidar_x', 1), 4, 'all')).toEqual([-2, 2]);
    expect(unknownStretches(unknown)).toEqual([[0, 1]]);
  });

  it('is marked for each time that it was so', () => {
    const found = series([0, 1, 2, 3, 4], [0, 0, 1, 0, 0]);
    for (const i of [0, 1, 3, 4]) found.status[i] = 'unobservable';
    expect(unknownStretches(found)).toEqual([
      [0, 1],
      [3, 4],
    ]);
  });
});

describe('the axis', () => {
  it('covers every value, but not a band of metres', () => {
    const data = columns(series([0, 1, 2], [0, 0.4, 0.434], 0.0005), 'lidar_x', 1);
    data[1][0] = 5000;
    const [low, high] = axisRange(data, 4, 'all');
    expect(low).toBeLessThan(0);
    expect(high).toBeGreaterThan(434);
    expect(high).toBeLessThan(600);
  });

  it('looks at the latest values when asked', () => {
    const means = Array.from({ length: 100 }, (_, i) => (i < 50 ? 0 : 0.434));
    const data = columns(
      series(
        means.map((_, i) => i),
        means,
        0.0005,
      ),
      'lidar_x',
      1,
    );
    const [low, high] = axisRange(data, 4, 'latest');
    expect(low).toBeGreaterThan(430);
    expect(high).toBeLessThan(438);
  });

  it('never magnifies noise beyond its smallest span, and stands without data', () => {
    const [low, high] = axisRange(columns(series([0, 1], [1, 1], 0), 'lidar_x', 1), 4, 'all');
    expect(high - low).toBeCloseTo(4);
    expect(axisRange([[], [], [], [], [], []], 4, 'all')).toEqual([-2, 2]);
  });
});

describe('a young robot', () => {
  /** A history whose first stretch holds both the assumed zero and the found 1021 mm. */
  const week = (): Series => {
    const young = series([0, 600, 1200, 1800], [0.6, 1.021, 1.0212, 1.0211], 0.0005);
    young.status = ['converged', 'converged', 'converged', 'converged'];
    young.min = [0, 1.0205, 1.0208, 1.0209];
    young.max = [1.03, 1.0215, 1.0216, 1.0213];
    young.sigma[0] = 0.2;
    return young;
  };

  it('is shown at the scale of what it has learnt, not of what was assumed before', () => {
    const data = columns(week(), 'lidar_x', 600);
    expect(data[5][0]).toBeNull();
    expect(data[5][1]).toBeCloseTo(1021);
    const [low, high] = axisRange(data, 4, 'all');
    expect(low).toBeGreaterThan(1015);
    expect(high).toBeLessThan(1027);
  });

  it('keeps a first stretch that is of one value', () => {
    const young = week();
    young.mean[0] = 1.0209;
    young.min[0] = 1.0203;
    young.max[0] = 1.0215;
    expect(columns(young, 'lidar_x', 600)[5][0]).toBeCloseTo(1020.9);
  });

  it('has an axis of converged values, once there are any', () => {
    const seconds = series([0, 1, 2, 3], [0.2, 0.9, 1.02, 1.021], 0.0005);
    seconds.status = ['learning', 'learning', 'converged', 'converged'];
    const data = columns(seconds, 'lidar_x', 1);
    expect(data[5].slice(0, 3)).toEqual([200, 900, 1020]);
    expect(axisRange(data, 4, 'all')[0]).toBeGreaterThan(1015);
  });
});

describe('a single stretch', () => {
  it('is a point, for there is no line', () => {
    const one = columns(series([0], [0.434], 0.0005), 'lidar_x', 7200);
    expect(isolated(one)).toEqual([0]);
    // It may hold what was assumed before: its spread does not set the axis.
    const mixed = series([0], [0.37], 0.15);
    mixed.min[0] = 0;
    mixed.max[0] = 0.41;
    const [low, high] = axisRange(columns(mixed, 'lidar_x', 7200), 4, 'all', [406]);
    expect(low).toBeGreaterThan(350);
    expect(high).toBeLessThan(430);
    const gap = columns(series([0, 1, 20, 40, 41], [1, 1, 1, 1, 1]), 'lidar_x', 1);
    expect(isolated(gap).map((i) => gap[0][i])).toEqual([20]);
    expect(isolated(columns(series([], []), 'lidar_x', 1))).toEqual([]);
  });

  it('stands in the middle of its bucket, and never after the end of the chart', () => {
    expect(lonePlace(7200, 7200, 20_000)).toEqual([7200, 10_800, 14_400]);
    expect(lonePlace(7200, 7200, 9000)).toEqual([7200, 8100, 9000]);
    expect(lonePlace(20, 1, 40)).toEqual([20, 20, 20]);
  });
});

describe('live points', () => {
  it('push out what is older than the window', () => {
    const kept = series([1, 2, 3], [1, 2, 3]);
    append(kept, 4, { value: 4, sigma: 0.1, status: 'converged' }, 3);
    expect(kept.t_s).toEqual([3, 4]);
    expect(kept.mean).toEqual([3, 4]);
    expect(kept.status.at(-1)).toBe('converged');
  });
});

describe('a CSV file', () => {
  it('has SI units in its head and all digits in its rows', () => {
    const text = csv(series([0], [0.1 + 0.2]), 'steering_offset', [{ t_s: 0, value: 0.25 }]);
    const [head, row] = text.split('\r\n');
    expect(head).toBe(
      'time_utc,steering_offset_rad,steering_offset_sigma_rad,steering_offset_min_rad,steering_offset_max_rad,steering_offset_applied_rad,status',
    );
    expect(row).toBe(
      '1970-01-01T00:00:00.000Z,0.30000000000000004,0.001,0.30000000000000004,0.30000000000000004,0.25,learning',
    );
  });
});

describe('the cursor', () => {
  it('finds the nearest point', () => {
    expect(nearest([], 3)).toBeNull();
    expect(nearest([1, 2, 10], 0)).toBe(0);
    expect(nearest([1, 2, 10], 5)).toBe(1);
    expect(nearest([1, 2, 10], 7)).toBe(2);
    expect(nearest([1, 2, 10], 99)).toBe(2);
  });
});

describe('an answer of the service', () => {
  it('becomes columns', () => {
    const made = allSeries({
      time: ['2026-11-21T13:00:00Z', '2026-11-21T13:01:00Z'],
      series: [
        {
          parameter: 'lidar_x',
          unit: 'm',
          mean: [null, 1],
          min: [null, 0],
          max: [null, 2],
          sigma: [null, 0.1],
          status: ['fixed', 'converged'],
        },
      ],
    }).get('lidar_x');
    // Where the parameter was fixed there is nothing to draw.
    expect(made?.t_s).toEqual([Date.UTC(2026, 10, 21, 13, 1) / 1000]);
    expect(made?.max).toEqual([2]);
    expect(made?.status).toEqual(['converged']);
  });
});
