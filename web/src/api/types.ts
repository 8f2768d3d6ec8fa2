/** What the service says: the schemas of its OpenAPI document, by shorter names. */

import type { components } from './schema';

type Schemas = components['schemas'];

export type ParameterName = Schemas['ParameterName'];
export type ParameterStatus = Schemas['ParameterStatus'];
export type Parameter = Schemas['ParameterDocument'];
export type Estimate = Schemas['EstimateDocument'];

export type Robot = Schemas['RobotSummary'];
export type RobotDocument = Schemas['RobotDocument'];
export type RobotPage = Schemas['RobotPage'];
export type RobotState = Schemas['RobotState'];
export type RobotStateUpdate = Schemas['RobotStateUpdate'];
export type RobotConfig = Schemas['RobotConfig'];
export type Vehicle = Schemas['VehicleDocument'];
export type VehicleModel = Schemas['VehicleModel'];
export type Stream = Schemas['StreamCounts'];

export type HistoryDocument = Schemas['HistoryDocument'];
export type HistorySeries = Schemas['HistorySeries'];
export type RobotEvent = Schemas['Event'];
export type EventKind = Schemas['EventKind'];
export type EventPage = Schemas['EventPage'];
export type NewEvent = Schemas['NewEvent'];
export type Problem = Schemas['Problem'];

export type Session = Schemas['Session'];
export type Role = Schemas['Role'];
