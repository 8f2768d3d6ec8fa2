/** What a robot's own description (URDF, static transforms) implies, in words for people. */

import { get } from '../api/client';
import type { DescribedRobot, DescribedValue, RobotConfig, VehicleModel } from '../api/types';
import { robotUrl } from '../fleet/fleet.svelte';

/** Address of what the robot says of itself. */
export function descriptionUrl(robot: string): string {
  return `${robotUrl(robot)}/description`;
}

/** Reads what the robot says of itself; undefined if it has said nothing. */
export async function readDescription(robot: string): Promise<DescribedRobot | undefined> {
  const { body } = await get<DescribedRobot>(descriptionUrl(robot));
  const { origins, remarks } = body.description;
  return origins.length > 0 || remarks.length > 0 ? body : undefined;
}

const LABELS: Record<string, string> = {
  model: 'Steering',
  speed_measured_at: 'Speed measured at',
  wheelbase_m: 'Wheelbase',
  track_m: 'Track',
  'streams.joints': 'Joints',
  rear_axle_in_base_link: 'Rear axle in base_link',
  nominal_extrinsics: 'LiDAR mount, nominal',
};

/** Name of a described value. */
export function labelOf(value: DescribedValue): string {
  return LABELS[value.key] ?? value.key;
}

const DEGREES = 180 / Math.PI;

/** Text of a described value or of the one in use. */
export function textOf(key: string, value: unknown): string {
  if (value === null || value === undefined) return 'not set';
  if (typeof value === 'number') return `${value.toFixed(3)} m`;
  if (typeof value !== 'object') return String(value);
  const fields = value as Record<string, unknown>;
  const { x_m: x, y_m: y, yaw_rad: yaw } = fields;
  if (typeof x === 'number' && typeof y === 'number' && typeof yaw === 'number') {
    return `x ${x.toFixed(3)} m, y ${y.toFixed(3)} m, yaw ${(yaw * DEGREES).toFixed(2)}°`;
  }
  if (key === 'streams.joints') {
    const { steering, wheels, wheel_radius_m: radius } = fields;
    const parts = [typeof steering === 'string' ? steering : 'no steering joint'];
    if (Array.isArray(wheels) && wheels.length > 0) parts.push(wheels.join(', '));
    if (typeof radius === 'number') parts.push(`radius ${radius.toFixed(3)} m`);
    return parts.join('; ');
  }
  return JSON.stringify(value);
}

/** True if taking the description over would change the robot's configuration. */
export function changes(described: DescribedRobot): boolean {
  const isMissing = (value: DescribedValue) =>
    value.key !== 'track_m' && (value.in_use ?? null) === null;
  const { values } = described.description;
  return described.proposed !== null && values.some((one) => isMissing(one) || one.contradicted);
}

/** First entries of the form for an unregistered robot. */
export interface Prefill {
  model?: VehicleModel;
  wheelbase?: string;
  /** Sources of the two, one a line. */
  sources: string[];
  /** The rest of the configuration. */
  rest: Partial<RobotConfig>;
}

/** Entries by a robot's description. */
export function prefill(described: DescribedRobot): Prefill {
  const { origins, values } = described.description;
  const of = (key: string) => values.find((value) => value.key === key);
  const [model, wheelbase] = [of('model'), of('wheelbase_m')];
  const filled: Prefill = {
    sources: [],
    rest: (described.proposed as Partial<RobotConfig> | null) ?? {},
  };
  const models = ['bicycle', 'tricycle', 'rear_steered'] as const;
  const known = models.find((name) => name === model?.value);
  if (known) filled.model = known;
  if (typeof wheelbase?.value === 'number') filled.wheelbase = String(wheelbase.value);
  for (const one of values) {
    if (one.key !== 'track_m')
      filled.sources.push(`${labelOf(one)}: ${textOf(one.key, one.value)}, by ${one.source}`);
  }
  if (filled.sources.length > 0) filled.sources.unshift(origins.join(', '));
  return filled;
}
