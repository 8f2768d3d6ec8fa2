/** Geometry of a robot's top view: conversion from metres to a drawing, to words and to a file. */

import type { TopView } from '../api/types';
import { fixed } from '../units/format';

export type Point = readonly number[];

/** A drawing: its size in pixels, the point in its middle, and its scale. Up is y. */
export interface View {
  width: number;
  height: number;
  middle: Point;
  px_per_m: number;
}

/** Widths of a drawing in metres, from near to far. */
export const WIDTHS_M = [6, 12, 24, 48] as const;

/** Returns the place of a point of the odometry frame in the drawing. */
export function place(view: View, [x = 0, y = 0]: Point): [number, number] {
  const [mx = 0, my = 0] = view.middle;
  return [view.width / 2 + (x - mx) * view.px_per_m, view.height / 2 - (y - my) * view.px_per_m];
}

const at = (view: View, point: Point) => {
  const [x, y] = place(view, point);
  return `${x.toFixed(1)} ${y.toFixed(1)}`;
};

/** Returns a path with a dot at each point inside the drawing. */
export function dots(view: View, points: readonly Point[]): string {
  return points
    .filter((point) => {
      const [x, y] = place(view, point);
      return x >= 0 && x <= view.width && y >= 0 && y <= view.height;
    })
    .map((point) => `M${at(view, point)}h0`)
    .join('');
}

/** Returns a path along the points. */
export function line(view: View, points: readonly Point[]): string {
  return points.map((point, i) => `${i === 0 ? 'M' : 'L'}${at(view, point)}`).join('');
}

/** Transforms a point of the frame `b` into the frame `a`, by the pose of `b` in `a`. */
export function onto({ x_m, y_m, yaw_rad }: TopView['lidar'], [x = 0, y = 0]: Point): Point {
  const [sin, cos] = [Math.sin(yaw_rad), Math.cos(yaw_rad)];
  return [x_m + cos * x - sin * y, y_m + sin * x + cos * y];
}

/** Returns the outline of the vehicle with a nose at its front; null while the mount is unknown. */
export function vehicle({ lidar, lidar_in_base }: TopView, wheelbase_m: number): Point[] | null {
  if (!lidar_in_base) return null;
  // From the vehicle to the LiDAR and back again: `base_in_odom = lidar_in_odom * base_in_lidar`.
  const { x_m, y_m, yaw_rad } = lidar_in_base;
  const [sin, cos] = [Math.sin(yaw_rad), Math.cos(yaw_rad)];
  const inLidar = ([x = 0, y = 0]: Point): Point => [
    cos * (x - x_m) + sin * (y - y_m),
    -sin * (x - x_m) + cos * (y - y_m),
  ];
  const half = 0.3 * wheelbase_m;
  const outline = [
    [-0.2 * wheelbase_m, half],
    [1.05 * wheelbase_m, half],
    [1.3 * wheelbase_m, 0],
    [1.05 * wheelbase_m, -half],
    [-0.2 * wheelbase_m, -half],
  ];
  return outline.map((corner) => onto(lidar, inLidar(corner)));
}

/** Returns a round length for a scale bar of at most `most_px`, m. */
export function scaleBar({ px_per_m }: View, most_px: number): number {
  const most = most_px / px_per_m;
  const power = 10 ** Math.floor(Math.log10(most));
  const digit = [5, 2, 1].find((digit) => digit * power <= most) ?? 1;
  return digit * power;
}

const apart = ([ax = 0, ay = 0]: Point, [bx = 0, by = 0]: Point) => Math.hypot(ax - bx, ay - by);

/**
 * Returns the distances of the two steerings' ends from the LiDAR's, m; null without trajectories.
 */
export function ends({ trajectory }: TopView): { raw_m: number; corrected_m: number } | null {
  const last = trajectory.at(-1);
  if (!last || trajectory.length < 2) return null;
  return {
    raw_m: apart(last.by_lidar_m, last.by_raw_steering_m),
    corrected_m: apart(last.by_lidar_m, last.by_corrected_steering_m),
  };
}

/** One point of a trajectory as a row of a table. */
export interface Row {
  /** Time before the newest point, s. */
  before_s: number;
  x_m: number;
  y_m: number;
  raw_off_m: number;
  corrected_off_m: number;
}

/** Returns the trajectories, the newest point first. */
export function rows({ trajectory }: TopView): Row[] {
  const newest_ns = trajectory.at(-1)?.stamp_ns ?? 0;
  return trajectory.toReversed().map((point) => ({
    before_s: (newest_ns - point.stamp_ns) / 1e9,
    x_m: point.by_lidar_m[0] ?? 0,
    y_m: point.by_lidar_m[1] ?? 0,
    raw_off_m: apart(point.by_lidar_m, point.by_raw_steering_m),
    corrected_off_m: apart(point.by_lidar_m, point.by_corrected_steering_m),
  }));
}

/** Describes the drawing in a sentence. */
export function inWords(view: TopView): string {
  const off = ends(view);
  if (!off) return 'Trajectories follow once a first calibration is found.';
  const metres = (m: number) => `${fixed(m, 2)} m`;
  return (
    `Over the last ${fixed(view.distance_m, 0)} m, raw steering ends ${metres(off.raw_m)} ` +
    `from where the LiDAR says, corrected steering ${metres(off.corrected_m)}.`
  );
}

/** Returns the whole drawing as a CSV file: kind, time if there is one, x and y. */
export function topViewCsv(view: TopView): string {
  const time = (stamp_ns: number) => new Date(stamp_ns / 1e6).toISOString();
  const still = (what: string, points: readonly Point[]) =>
    points.map(([x = 0, y = 0]) => [what, '', x, y]);
  const moving = (
    what: string,
    key: 'by_lidar_m' | 'by_raw_steering_m' | 'by_corrected_steering_m',
  ) => view.trajectory.map((point) => [what, time(point.stamp_ns), ...point[key]]);
  const all = [
    ['what', 'time_utc', 'x_m', 'y_m'],
    ['lidar', time(view.stamp_ns), view.lidar.x_m, view.lidar.y_m],
    ...moving('rear_axle_by_lidar', 'by_lidar_m'),
    ...moving('rear_axle_by_raw_steering', 'by_raw_steering_m'),
    ...moving('rear_axle_by_corrected_steering', 'by_corrected_steering_m'),
    ...still('return', view.returns_m),
    ...still('surface', view.surfaces_m),
  ];
  return all.map((row) => row.join(',')).join('\r\n') + '\r\n';
}
