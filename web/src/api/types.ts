/** Schemas of the service's OpenAPI document, by shorter names. */

import type { components } from './schema';

type Schemas = components['schemas'];

export type ParameterName = Schemas['ParameterName'];
export type ParameterStatus = Schemas['ParameterStatus'];
export type Parameter = Schemas['ParameterDocument'];
export type Estimate = Schemas['EstimateDocument'];
export type SteeringTable = Schemas['SteeringTable'];
export type Consistency = Schemas['Consistency'];
export type Innovation = Schemas['Innovation'];
export type Innovations = Schemas['Innovations'];
export type Detection = Schemas['Detection'];
export type DetectionState = Schemas['DetectionState'];

export type Robot = Schemas['RobotSummary'];
export type RobotDocument = Schemas['RobotDocument'];
export type RobotPage = Schemas['RobotPage'];
export type RobotsOfView = Schemas['RobotsOfView'];
export type FleetStatistics = Schemas['StatisticsDocument'];
export type Distribution = Schemas['Distribution'];
export type Grouping = Schemas['Grouping'];
export type RobotState = Schemas['RobotState'];
export type Standing = Schemas['Standing'];
export type RobotRow = Schemas['RobotRow'];
export type RobotStateUpdate = Schemas['RobotStateUpdate'];
/** A robot's configuration as sent to the service: keys that have a default may be left out. */
export type RobotConfig = Omit<Schemas['RobotConfig'], 'streams'> & {
  streams?: Partial<Schemas['RobotStreams']>;
};
/** What a robot's own description implies. */
export type DescribedRobot = Schemas['DescribedRobot'];
export type DescribedValue = Schemas['DescribedValue'];
export type Vehicle = Schemas['VehicleDocument'];
export type VehicleModel = Schemas['VehicleModel'];
export type MessageType = Schemas['MessageType'];
export type AnnouncedTopic = Schemas['AnnouncedTopic'];
export type Stream = Schemas['StreamCounts'];
export type Checks = Schemas['Checks'];
export type Preview = Schemas['Preview'];
export type Moment = Schemas['Moment'];
export type Moments = Schemas['Moments'];
export type SupportList = Schemas['SupportList'];
export type CheckFinding = Schemas['CheckFinding'];
export type CheckedStream = Schemas['CheckedStream'];
export type CheckState = Schemas['CheckState'];

export type HistoryDocument = Schemas['HistoryDocument'];
export type HistorySeries = Schemas['HistorySeries'];
export type RobotEvent = Schemas['Event'];
export type EventKind = Schemas['EventKind'];
export type EventPage = Schemas['EventPage'];
export type NewEvent = Schemas['NewEvent'];
export type Problem = Schemas['Problem'];

export type Session = Schemas['Session'];
export type Role = Schemas['Role'];

export type Values = Schemas['CalibrationValues'];
export type CalibrationSummary = Schemas['CalibrationSummary'];
export type Policy = Schemas['Policy'];
export type PolicyInForce = Schemas['PolicyInForce'];
export type PolicyRequest = Schemas['PolicyRequest'];
export type Tolerance = Schemas['Tolerance'];
export type Proposal = Schemas['Proposal'];
export type ProposalState = Schemas['ProposalState'];
export type SecondApprover = Schemas['SecondApprover'];
export type ProposalPage = Schemas['ProposalPage'];
export type SeveralApprovals = Schemas['SeveralApprovals'];
export type SeveralAnswer = Schemas['SeveralAnswer'];
export type FleetAction = Schemas['FleetAction'];
export type FleetActionAnswer = Schemas['FleetActionAnswer'];
export type ActionTarget = Schemas['ActionTarget'];
export type RetiredRobot = Schemas['RetiredRobot'];
export type Rollout = Schemas['Rollout'];
export type RolloutPage = Schemas['RolloutPage'];
export type RolloutPlan = Schemas['RolloutPlan'];
export type RolloutLost = Schemas['RolloutLost'];
export type RolloutRobot = Schemas['RolloutRobot'];
export type RolloutWave = Schemas['RolloutWave'];
export type RolloutStage = Schemas['RolloutStage'];
export type RolloutState = Schemas['RolloutState'];
export type WavePlan = Schemas['WavePlan'];
export type DeploymentFreeze = Schemas['DeploymentFreeze'];
export type Shadow = Schemas['Shadow'];
export type InUse = Schemas['InUse'];
export type Deployment = Schemas['Deployment'];
export type DeploymentPage = Schemas['DeploymentPage'];
export type CertificatePage = Schemas['CertificatePage'];
export type Certificate = Schemas['CertificateSummary'];
export type DeploymentState = Schemas['DeploymentState'];
export type CrossTrackErrors = Schemas['CrossTrackErrors'];
export type Manoeuvres = Schemas['Manoeuvres'];
export type TopView = Schemas['TopView'];
export type CrossTrackItem = Schemas['CrossTrackItem'];

export type LiveEvent = Schemas['LiveEvent'];

export type Alert = Schemas['Alert'];
export type AlertKind = Schemas['AlertKind'];
export type AlertState = Schemas['AlertState'];
export type AlertWithHistory = Schemas['AlertWithHistory'];
export type AuditRow = Schemas['AuditRow'];
export type AuditPage = Schemas['AuditPage'];

export type User = Schemas['User'];
export type Token = Schemas['Token'];
export type Webhook = Schemas['Webhook'];
export type WebhookList = Schemas['WebhookList'];
export type WebhookEvent = Schemas['WebhookEvent'];
export type WebhookWithSecret = Schemas['WebhookWithSecret'];
export type WebhookDelivery = Schemas['WebhookDelivery'];
export type SigningKey = Schemas['SigningKeyDocument'];
export type Readiness = Schemas['Readiness'];
export type Cluster = Schemas['Cluster'];
export type Instance = Schemas['Instance'];
export type WebhookDeliveryPage = Schemas['DeliveryPage'];
