/** Comparison of a robot's estimate with the applied calibration. */

import type { Robot, Tolerance, Values } from '../api/types';
import { type Compared, compareValues } from '../units/values';

/** Compares value by value; undefined while there is no estimate. */
export function againstApplied(
  { estimate, calibration }: Robot,
  tolerance: Tolerance | undefined,
): Compared[] | undefined {
  if (!estimate) return undefined;
  const { parameters } = estimate;
  const pick = (of: 'value' | 'sigma'): Values => ({
    steering_offset_rad: parameters.steering_offset[of],
    lidar_x_m: parameters.lidar_x[of],
    lidar_y_m: parameters.lidar_y[of],
    lidar_yaw_rad: parameters.lidar_yaw[of],
  });
  return compareValues(calibration.in_use, pick('value'), pick('sigma'), tolerance);
}
