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
  needs: string | null;
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
export interface StreamView {
  stream: string;
  messages: number;
  rate_hz: number;
  last_received_at: string | null;
}
export interface Connection {
  last_seen_at: string | null;
  stale: boolean;
  alive: boolean;
  streams: StreamView[];
}
export interface Counters {
  received: number;
  processed: number;
  shed_drive: number;
  shed_scans: number;
  shed_notes: number;
  refused: number;
  last_refusal: string | null;
  waiting: number;
  estimator_restarts: number;
}
export type VehicleModel = 'bicycle' | 'tricycle';
export interface RobotConfig {
  model: VehicleModel;
  wheelbase_m: number;
  speed_measured_at?: 'rear_axle' | 'steered_wheel' | { rear_wheel: { lateral_m: number } };
  nominal?: { x_m: number; y_m: number; yaw_rad: number };
  drive?: 'raw' | 'compensated';
}
export interface Robot {
  id: string;
  state: RobotState;
  config: RobotConfig | null;
  connection: Connection;
  estimate: Estimate | null;
  counters: Counters;
}
export interface HistoryPoint {
  time: string;
  mean: number;
  min: number;
  max: number;
  sigma: number;
  status: ParameterStatus;
}
export interface HistoryAnswer {
  robot: string;
  resolution_s: number;
  parameters: Partial<Record<ParameterName, HistoryPoint[]>>;
}
export interface RobotEvent {
  id: number;
  robot: string;
  kind: string;
  time: string;
  source: string;
  author: string | null;
  note: string | null;
  details: {
    cause?: string;
    time_s?: number;
    onset_s?: number;
    change?: Partial<Record<ParameterName, number>>;
  } | null;
}
