import { describe, expect, it } from 'vitest';
import type { TopView } from '../api/types';
import { boxOf, floorOf, placeOn, robotIn, trailOf, transform, viewOf } from './drawing';
import { place } from '../robot/top-view';

const RADIUS_M = 3;

/** A line of points 0.2 m apart: straight on, then a bend to the left with a radius of 3 m. */
const line = (straight_m: number, bend_m: number, turned_rad = 0): [number, number][] => {
  const points: [number, number][] = [];
  for (let way_m = 0; way_m <= straight_m + bend_m + 1e-9; way_m += 0.2) {
    const angle = Math.max(0, way_m - straight_m) / RADIUS_M;
    const [x, y] = [
      Math.min(way_m, straight_m) + RADIUS_M * Math.sin(angle),
      RADIUS_M * (1 - Math.cos(angle)),
    ];
    const [sin, cos] = [Math.sin(turned_rad), Math.cos(turned_rad)];
    points.push([7 + cos * x - sin * y, -2 + sin * x + cos * y]);
  }
  return points;
};
const path = (straight_m: number, bend_m: number) =>
  line(straight_m, bend_m).map(([x, y]) => [x - 7, y + 2]);

describe('the place of a robot on a manoeuvre', () => {
  const turn = path(2, 5);

  it('is as far along as its trail has followed it, whichever way it heads', () => {
    const trail = line(2, 3, 1.1);
    const [x_m, y_m] = trail.at(-1) ?? [0, 0];
    const robot = { x_m, y_m, yaw_rad: 1.1 + 1 };
    const found = placeOn(turn, trail, robot);
    expect(found.along_m).toBeGreaterThan(4.5);
    expect(found.along_m).toBeLessThan(5.5);
    const [x, y] = transform(found.path_from_odom, [x_m, y_m]);
    const end = path(2, 3).at(-1) ?? [0, 0];
    expect(Math.hypot((x ?? 0) - (end[0] ?? 0), (y ?? 0) - (end[1] ?? 0))).toBeLessThan(0.5);
  });

  it('is its begin where it has driven something else, all of it, or nothing', () => {
    const robot = { x_m: 7, y_m: -2, yaw_rad: 0.3 };
    const right = line(0, 8).map(([x, y]) => [x, -4 - y] as [number, number]);
    expect(placeOn(turn, right, robot).along_m).toBe(0);
    expect(placeOn(path(10, 0), line(20, 0), robot).along_m).toBe(0);
    const still = placeOn(turn, [], robot);
    expect(still.along_m).toBe(0);
    const [x, y] = transform(still.path_from_odom, [7, -2]);
    expect([x, y]).toEqual([expect.closeTo(0), expect.closeTo(0)]);
    // Ahead of the robot is ahead on the path.
    const ahead = transform(still.path_from_odom, [7 + Math.cos(0.3), -2 + Math.sin(0.3)]);
    expect(ahead).toEqual([expect.closeTo(1), expect.closeTo(0)]);
  });

  it('counts what was driven since the report alone', () => {
    const view = {
      trajectory: line(1, 0).map((by_lidar_m, i) => ({ stamp_ns: i * 1e9, by_lidar_m })),
    } as unknown as TopView;
    expect(trailOf(view, 3e9)).toHaveLength(3);
  });

  it('needs the mount, by which the rear axle is found', () => {
    const lidar = { x_m: 1, y_m: 2, yaw_rad: Math.PI / 2 };
    expect(robotIn({ lidar, lidar_in_base: null } as unknown as TopView)).toBeNull();
    const lidar_in_base = { x_m: 0.5, y_m: 0, yaw_rad: 0 };
    const found = robotIn({ lidar, lidar_in_base } as unknown as TopView);
    expect(found).toEqual({
      x_m: expect.closeTo(1),
      y_m: expect.closeTo(1.5),
      yaw_rad: Math.PI / 2,
    });
  });
});

describe('the view', () => {
  it('draws the floor around the path, whichever way round it fits', () => {
    const straight = floorOf({ path_m: path(10, 0), length_m: 10, width_m: 1 });
    expect(straight.flat()).toEqual([0, -0.5, 10, 0.5].map((m) => expect.closeTo(m)));
    const eight = [
      [-3, 6],
      [3, -6],
    ];
    const turned = floorOf({ path_m: eight, length_m: 12, width_m: 6 });
    expect(turned).toEqual([
      [-3, -6],
      [3, 6],
    ]);
  });

  it('heads upwards and holds the whole manoeuvre', () => {
    const turn = path(2, 5);
    const view = viewOf(boxOf(turn), 300, 200, 1);
    const on = turn.map(([x = 0, y = 0]) => place(view, [-y, x]));
    for (const [px, py] of on) {
      expect(px).toBeGreaterThanOrEqual(0);
      expect(px).toBeLessThanOrEqual(300);
      expect(py).toBeGreaterThanOrEqual(0);
      expect(py).toBeLessThanOrEqual(200);
    }
    const [[bx = 0, by = 0] = [], [ex = 0, ey = 0] = []] = [on[0], on.at(-1)];
    // It begins below and ends above, to the left.
    expect(by).toBeGreaterThan(ey);
    expect(bx).toBeGreaterThan(ex);
  });
});
