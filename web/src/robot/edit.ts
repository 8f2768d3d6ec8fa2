/** Edit of a robot's vehicle and nominal mount: what is typed, as a configuration. */

import type { RobotConfig, RobotDocument, VehicleModel } from '../api/types';
import { wheelbase } from './vehicle';

const DEG = Math.PI / 180;
const MOUNT_MAX_MM = 30_000;
const TURN_DEG = 360;

/** Values as typed: wheelbase in m, mount in mm and degrees. */
export interface Typed {
  model: VehicleModel;
  wheelbase: string;
  x_mm: string;
  y_mm: string;
  yaw_deg: string;
}

export type Edited = { ok: true; config: RobotConfig } | { ok: false; problem: string };

/** Words for the fields of a configuration whose change restarts the estimate. */
const KEYS: Record<string, string> = {
  model: 'how it steers',
  wheelbase_m: 'the wheelbase',
  speed_measured_at: 'where the speed is measured',
  nominal_extrinsics: 'the nominal mount',
  estimator: 'the settings of its estimator',
  wheel_odometry: 'the kind of its steering angle',
  'streams.joints': 'its joints',
};

/** Returns the values of a configuration as they are typed. */
export function typedOf(config: NonNullable<RobotDocument['config']>): Typed {
  const mount = config.nominal_extrinsics ?? undefined;
  const text = (value: number | undefined, digits: number) =>
    value === undefined ? '' : String(Number(value.toFixed(digits)));
  return {
    model: config.model,
    wheelbase: text(config.wheelbase_m, 6),
    x_mm: text(mount && mount.x_m * 1000, 3),
    y_mm: text(mount && mount.y_m * 1000, 3),
    yaw_deg: text(mount && mount.yaw_rad / DEG, 6),
  };
}

/**
 * Returns the configuration with the typed values; what is not typed again keeps its value, and all
 * other fields stay.
 */
export function edited(config: NonNullable<RobotDocument['config']>, typed: Typed): Edited {
  const before = typedOf(config);
  const base = wheelbase(typed.wheelbase);
  if (!base.ok) return base;
  const wheelbase_m = typed.wheelbase === before.wheelbase ? config.wheelbase_m : base.metres;
  const fields = [typed.x_mm, typed.y_mm, typed.yaw_deg].map((field) => field.trim());
  const changed = { ...config, model: typed.model, wheelbase_m };
  if (fields.every((field) => field === '')) {
    return { ok: true, config: { ...changed, nominal_extrinsics: null } };
  }
  const [x, y, yaw] = fields.map((field) => Number(field.replace(',', '.').replace('−', '-')));
  if (fields.includes('') || !isWithin(x, MOUNT_MAX_MM) || !isWithin(y, MOUNT_MAX_MM)) {
    const problem = 'The mount needs forward, left and yaw, in mm (at most 30 m) and degrees.';
    return { ok: false, problem };
  }
  if (!isWithin(yaw, TURN_DEG)) {
    return { ok: false, problem: 'The yaw of the mount is in degrees, within one turn.' };
  }
  const mount = config.nominal_extrinsics;
  const keep = (typedNow: string, typedBefore: string, now: number, was: number | undefined) =>
    typedNow === typedBefore && was !== undefined ? was : now;
  const nominal_extrinsics = {
    x_m: keep(typed.x_mm, before.x_mm, x / 1000, mount?.x_m),
    y_m: keep(typed.y_mm, before.y_mm, y / 1000, mount?.y_m),
    yaw_rad: keep(typed.yaw_deg, before.yaw_deg, yaw * DEG, mount?.yaw_rad),
  };
  return { ok: true, config: { ...changed, nominal_extrinsics } };
}

function isWithin(value: number | undefined, most: number): value is number {
  return value !== undefined && Number.isFinite(value) && Math.abs(value) <= most;
}

/** Returns what a change restarts, in a sentence. */
export function effect(keys: readonly string[]): string {
  if (keys.length === 0) return 'The estimate goes on: nothing that it depends on changes.';
  const words = keys.map((key) => KEYS[key] ?? key);
  const last = words.pop() ?? '';
  const list = words.length > 0 ? `${words.join(', ')} and ${last}` : last;
  const them = keys.length === 1 ? 'it' : 'them';
  return (
    `The estimate begins again, since ${list} ${keys.length === 1 ? 'changes' : 'change'} and it was learned with ${them}. ` +
    'The calibration that the robot uses stays in use.'
  );
}
