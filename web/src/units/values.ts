/** The values of a calibration under the parameters' names elsewhere. */

import type { ParameterName, Tolerance, Values } from '../api/types';
import { CALIBRATED, NUISANCE } from './parameters';

export type Calibrated = (typeof CALIBRATED)[number];

const KEYS = {
  steering_offset: 'steering_offset_rad',
  lidar_x: 'lidar_x_m',
  lidar_y: 'lidar_y_m',
  lidar_yaw: 'lidar_yaw_rad',
  speed_scale: 'speed_scale',
  wheelbase: 'wheelbase_m',
  time_offset: 'time_offset_s',
  steering_gain: 'steering_gain',
} as const satisfies Record<ParameterName, keyof Values>;

const RAD_PER_DEG = Math.PI / 180;

/** Returns one value, in its wire unit; null if it is unknown. */
export function valueOf(values: Values | null | undefined, name: ParameterName): number | null {
  return values?.[KEYS[name]] ?? null;
}

/** Returns `to` less `from`; the shorter way round for a heading. */
export function difference(name: ParameterName, from: number, to: number): number {
  const plain = to - from;
  if (name !== 'lidar_yaw') return plain;
  return Math.atan2(Math.sin(plain), Math.cos(plain));
}

/** Returns the accepted deviation of one value by a tolerance, in its wire unit. */
export function accepted(tolerance: Tolerance, name: Calibrated): number {
  if (name === 'steering_offset') return tolerance.steering_offset_deg * RAD_PER_DEG;
  if (name === 'lidar_yaw') return tolerance.lidar_yaw_deg * RAD_PER_DEG;
  return tolerance.lidar_position_mm / 1000;
}

/** One value of a calibration beside the one that would replace it. */
export interface Compared {
  name: ParameterName;
  from: number | null;
  to: number | null;
  sigma: number | null;
  change: number | null;
  /** Size of the change in sigmas; null without a sigma. */
  sigmas: number | null;
  /** True if the change exceeds the tolerance; false without one. */
  beyond: boolean;
}

/** Compares two calibrations value by value. */
export function compareValues(
  from: Values | null | undefined,
  to: Values | null | undefined,
  sigmas: Values | null | undefined,
  tolerance: Tolerance | undefined,
): Compared[] {
  return CALIBRATED.map((name) => {
    const before = valueOf(from, name);
    const after = valueOf(to, name);
    const sigma = valueOf(sigmas, name) || null;
    const change = before === null || after === null ? null : difference(name, before, after);
    const size = Math.abs(change ?? 0);
    return {
      name,
      from: before,
      to: after,
      sigma,
      change,
      sigmas: change === null || sigma === null ? null : size / sigma,
      beyond: tolerance !== undefined && size > accepted(tolerance, name),
    };
  });
}

/** Assumed values of a robot that has not reported them. Its assumed wheelbase is unknown. */
const UNSAID: Record<(typeof NUISANCE)[number], number | null> = {
  speed_scale: 1,
  time_offset: 0,
  wheelbase: null,
  steering_gain: 1,
};
/** Difference below which two values are equal, in any wire unit. */
const SAME = 1e-9;

/**
 * Returns the further values beside the four of {@link compareValues} that would change: every
 * value that a robot will apply is displayed. A value in use that would no longer be sent is
 * included too.
 */
export function compareBeside(
  from: Values | null | undefined,
  to: Values | null | undefined,
  sigmas: Values | null | undefined,
): Compared[] {
  return NUISANCE.flatMap((name) => {
    const before = valueOf(from, name) ?? UNSAID[name];
    const after = valueOf(to, name);
    if (after === null && (before === null || before === UNSAID[name])) return [];
    const change = before === null || after === null ? null : after - before;
    if (change !== null && Math.abs(change) < SAME) return [];
    const sigma = valueOf(sigmas, name) || null;
    const counted = change === null || sigma === null ? null : Math.abs(change) / sigma;
    return [{ name, from: before, to: after, sigma, change, sigmas: counted, beyond: false }];
  });
}
