/** Names and units under which the parameters of a calibration are shown to people. */

import type { ParameterName } from '../api/types';

export interface Shown {
  /** Name in a heading. */
  label: string;
  /** Unit for people; the wire has rad, m, s and 1. */
  unit: string;
  /** Shown value per wire value. */
  factor: number;
  /** Number of digits after the point. */
  decimals: number;
  /** Unit as part of a CSV column name, where the wire's unit is kept. */
  wireUnit: string;
  /** The narrowest span a chart's axis is allowed to show, in the shown unit. */
  smallestSpan: number;
}

const DEGREES = 180 / Math.PI;

const angle = (label: string): Shown => ({
  label,
  unit: '°',
  factor: DEGREES,
  decimals: 3,
  wireUnit: 'rad',
  smallestSpan: 0.04,
});

const length = (label: string): Shown => ({
  label,
  unit: 'mm',
  factor: 1000,
  decimals: 1,
  wireUnit: 'm',
  smallestSpan: 4,
});

const ratio = (label: string): Shown => ({
  label,
  unit: '',
  factor: 1,
  decimals: 4,
  wireUnit: 'ratio',
  smallestSpan: 0.004,
});

export const SHOWN: Record<ParameterName, Shown> = {
  steering_offset: angle('Steering offset'),
  lidar_x: length('LiDAR x'),
  lidar_y: length('LiDAR y'),
  lidar_yaw: angle('LiDAR yaw'),
  speed_scale: ratio('Speed scale'),
  wheelbase: length('Wheelbase'),
  time_offset: {
    label: 'Time offset',
    unit: 'ms',
    factor: 1000,
    decimals: 1,
    wireUnit: 's',
    smallestSpan: 4,
  },
  steering_gain: ratio('Steering gain'),
};

/** Parameters of a fleet row and of the charts, in this order. */
export const CALIBRATED = ['steering_offset', 'lidar_x', 'lidar_y', 'lidar_yaw'] as const;

/** Further parameters of the filter. */
export const NUISANCE = ['speed_scale', 'time_offset', 'wheelbase', 'steering_gain'] as const;
