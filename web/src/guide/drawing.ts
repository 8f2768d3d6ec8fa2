/**
 * Drawing of a manoeuvre to scale: its path in its own frame, which begins at the origin and heads
 * along x, and the robot on it.
 */

import type { TopView } from '../api/types';
import type { Point, View } from '../robot/top-view';
import type { Manoeuvre } from './guide';

/** Pose in the plane: position, m, and heading, rad. */
export interface Pose {
  x_m: number;
  y_m: number;
  yaw_rad: number;
}

/** Distance between points that are compared, m. */
const STEP_M = 0.5;
/** Shortest way by which one manoeuvre is told from another, m. */
const WAY_MIN_M = 3;
/** Largest distance from the path of a robot that follows it, as a share of the way compared. */
const OFF_SHARE = 0.06;

const x = (point: Point) => point[0] ?? 0;
const y = (point: Point) => point[1] ?? 0;
const apart = (a: Point, b: Point) => Math.hypot(x(a) - x(b), y(a) - y(b));

/** Returns the way along a line at each of its points, m. */
export function waysAlong(points: readonly Point[]): number[] {
  let way_m = 0;
  return points.map((point, i) => {
    const before = points[i - 1];
    if (before) way_m += apart(before, point);
    return way_m;
  });
}

/** Returns the point of a line at a way, linear between its points. */
function pointAt(points: readonly Point[], ways_m: readonly number[], way_m: number): Point {
  const after = ways_m.findIndex((one) => one >= way_m);
  const [from, to] = [points[after - 1], points[after]];
  if (!to) return points.at(-1) ?? [0, 0];
  if (!from) return to;
  const [begin, end] = [ways_m[after - 1] ?? 0, ways_m[after] ?? 0];
  const share = end > begin ? (way_m - begin) / (end - begin) : 0;
  return [x(from) + share * (x(to) - x(from)), y(from) + share * (y(to) - y(from))];
}

/** Place of the robot on a manoeuvre. */
export interface Place {
  /** Way along the manoeuvre, m. */
  along_m: number;
  /** Transforms points of the odometry frame into the manoeuvre's. */
  path_from_odom: Pose;
}

/** Transforms a point of the frame `b` into the frame `a`. */
export function transform(a_from_b: Pose, point: Point): Point {
  const [sin, cos] = [Math.sin(a_from_b.yaw_rad), Math.cos(a_from_b.yaw_rad)];
  return [
    a_from_b.x_m + cos * x(point) - sin * y(point),
    a_from_b.y_m + sin * x(point) + cos * y(point),
  ];
}

/** Returns the transform that takes a point to another after a turn. */
function moving(from: Point, to: Point, yaw_rad: number): Pose {
  const turned = transform({ x_m: 0, y_m: 0, yaw_rad }, from);
  return { x_m: x(to) - x(turned), y_m: y(to) - y(turned), yaw_rad };
}

/**
 * Returns the place of a robot on a path by its trail, oldest point first: the longest way along
 * the path that the end of the trail has followed. A robot that has followed none of it, or all of
 * it, stands at its begin.
 */
export function placeOn(path: readonly Point[], trail: readonly Point[], robot: Pose): Place {
  const begin = moving([robot.x_m, robot.y_m], [0, 0], -robot.yaw_rad);
  const start: Place = { along_m: 0, path_from_odom: begin };
  const [path_ways_m, trail_ways_m] = [waysAlong(path), waysAlong(trail)];
  const trail_m = trail_ways_m.at(-1) ?? 0;
  const whole_m = path_ways_m.at(-1) ?? 0;
  // The trail is cut: further along a long path its last metres count.
  const candidates = path_ways_m.filter((way_m) => way_m >= WAY_MIN_M);
  let best = { compared_m: 0, place: start };
  for (const along_m of candidates) {
    const compared_m = Math.min(along_m, trail_m);
    if (compared_m < WAY_MIN_M || compared_m <= best.compared_m) continue;
    const steps = Array.from({ length: Math.floor(compared_m / STEP_M) + 1 }, (_, i) => i * STEP_M);
    const on = steps.map((back_m) => pointAt(path, path_ways_m, along_m - back_m));
    const driven = steps.map((back_m) => pointAt(trail, trail_ways_m, trail_m - back_m));
    const path_from_odom = fitted(driven, on);
    const off_m = Math.max(
      ...driven.map((point, i) => apart(transform(path_from_odom, point), on[i] ?? [0, 0])),
    );
    if (off_m <= OFF_SHARE * compared_m) {
      best = { compared_m, place: { along_m, path_from_odom } };
    }
  }
  return best.place.along_m < whole_m ? best.place : start;
}

/** Returns the transform that takes the first points onto each other and turns the others best. */
function fitted(from: readonly Point[], onto: readonly Point[]): Pose {
  const [begin, end] = [from[0] ?? [0, 0], onto[0] ?? [0, 0]];
  let [dot, cross] = [0, 0];
  from.forEach((point, i) => {
    const to = onto[i] ?? end;
    const [ax, ay] = [x(point) - x(begin), y(point) - y(begin)];
    const [bx, by] = [x(to) - x(end), y(to) - y(end)];
    dot += ax * bx + ay * by;
    cross += ax * by - ay * bx;
  });
  return moving(begin, end, Math.atan2(cross, dot));
}

/** Returns the pose of the rear axle in the odometry frame; null while the mount is unknown. */
export function robotIn({ lidar, lidar_in_base }: TopView): Pose | null {
  if (!lidar_in_base) return null;
  const yaw_rad = lidar.yaw_rad - lidar_in_base.yaw_rad;
  return moving([lidar_in_base.x_m, lidar_in_base.y_m], [lidar.x_m, lidar.y_m], yaw_rad);
}

/** Returns the trail of the rear axle since a time of the robot's clock, oldest point first. */
export function trailOf({ trajectory }: TopView, since_ns: number): Point[] {
  return trajectory.filter(({ stamp_ns }) => stamp_ns >= since_ns).map((point) => point.by_lidar_m);
}

/** Path of a manoeuvre and the sides of the floor that it needs, m. */
type Floor = Pick<Manoeuvre, 'path_m' | 'length_m' | 'width_m'>;

/** Rectangle in the manoeuvre's frame: its smallest and largest corner. */
export type Box = [low: Point, high: Point];

/** Returns the smallest rectangle around points. */
export function boxOf(points: readonly Point[]): Box {
  const [xs, ys] = [points.map(x), points.map(y)];
  return [
    [Math.min(...xs), Math.min(...ys)],
    [Math.max(...xs), Math.max(...ys)],
  ];
}

/** Returns the floor that a manoeuvre needs, around the middle of its path. */
export function floorOf({ path_m, length_m, width_m }: Floor): Box {
  const [low, high] = boxOf(path_m);
  const [along_m, across_m] = [x(high) - x(low), y(high) - y(low)];
  const fits = along_m <= length_m + 0.01 && across_m <= width_m + 0.01;
  const [long_m, wide_m] = fits ? [length_m, width_m] : [width_m, length_m];
  const [mx, my] = [(x(low) + x(high)) / 2, (y(low) + y(high)) / 2];
  return [
    [mx - long_m / 2, my - wide_m / 2],
    [mx + long_m / 2, my + wide_m / 2],
  ];
}

/** Returns a view of a rectangle with a margin around it, m, that heads upwards along x. */
export function viewOf([low, high]: Box, width: number, height: number, margin_m: number): View {
  const [along_m, across_m] = [x(high) - x(low), y(high) - y(low)];
  return {
    width,
    height,
    // Upwards is the path's x, to the left its y.
    middle: upwards([(x(low) + x(high)) / 2, (y(low) + y(high)) / 2]),
    px_per_m: Math.min(width / (across_m + 2 * margin_m), height / (along_m + 2 * margin_m)),
  };
}

/** Turns a point of the manoeuvre's frame so that its heading points upwards. */
export function upwards(point: Point): Point {
  return [-y(point), x(point)];
}
