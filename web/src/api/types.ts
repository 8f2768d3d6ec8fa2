/** What the service says, by the names of its OpenAPI document. */

export type ParameterName =
  | 'steering_offset'
  | 'lidar_x'
  | 'lidar_y'
  | 'lidar_yaw'
  | 'speed_scale'
  | 'wheelbase'
  | 'time_offset'
  | 'steering_gain';
export type ParameterStatus = 'converged' | 'learning' | 'unobservable' | 'fixed' | 'off';
export interface Parameter {
  value: number;
  sigma: number;
  unit: 'rad' | 'm' | 's' | '1';
  status: ParameterStatus;
  needs?: string | null;
}
export interface Estimate {
  robot: string;
  stamp_ns: number;
  time_s: number;
  distance_m: number;
  parameters: Record<ParameterName, Parameter>;
  consistency: { nis_mean: number; nis_dof: number; samples: number };
  counts: {
    drive_samples: number;
    scans: number;
    scans_rejected: number;
    late: number;
    duplicates: number;
  };
}
export type RobotState =
  'unregistered' | 'no_data' | 'failed' | 'changed' | 'learning' | 'calibrated';
export interface Stream {
  stream: string;
  messages: number;
  rate_hz: number;
  last_received?: string | null;
}
export interface Counters {
  received: number;
  processed: number;
  shed_drive: number;
  shed_scans: number;
  shed_notes: number;
  refused: number;
  ignored: number;
  last_refusal?: string | null;
  waiting: number;
}
export type VehicleModel = 'bicycle' | 'tricycle' | 'differential';
export interface Vehicle {
  model: VehicleModel;
  wheelbase_m: number;
}
export interface Robot {
  id: string;
  state: RobotState;
  stale: boolean;
  alive: boolean;
  last_seen?: string | null;
  estimate?: Estimate | null;
  vehicle?: Vehicle | null;
  streams: Stream[];
}
export interface RobotConfig extends Vehicle {
  drive?: 'raw' | 'compensated';
}
export interface RobotDocument extends Robot {
  config?: RobotConfig | null;
  version: number;
  counters: Counters;
  estimator_restarts: number;
}
export interface RobotPage {
  items: Robot[];
  next?: string | null;
}
export interface RobotStateUpdate {
  robot: string;
  state: RobotState;
  stale: boolean;
  alive: boolean;
}
export interface HistorySeries {
  parameter: ParameterName;
  mean: (number | null)[];
  min: (number | null)[];
  max: (number | null)[];
  sigma: (number | null)[];
  status: (ParameterStatus | null)[];
}
export interface HistoryDocument {
  bucket_s: number;
  time: string[];
  series: HistorySeries[];
}
export interface RobotEvent {
  id?: number | null;
  robot: string;
  kind: string;
  time: string;
  received: string;
  source: string;
  author?: string | null;
  note?: string | null;
  details?: Record<string, unknown> | null;
}
