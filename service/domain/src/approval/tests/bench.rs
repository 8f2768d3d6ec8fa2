//! Bench of one robot, which applies commands as the lifecycle does.

use fleetcal_model::{
    Consistency, Counts, DeploymentId, Generation, Parameter, ParameterStatus, Pose2, ProposalId,
    RevisionId, RobotTime, WallTime,
};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::{Applied, AppliedStatus, CalibrationDocument, CalibrationValues};
use fleetcal_proto::estimate::{EstimateDocument, ParameterDocument, Parameters};
use fleetcal_proto::signing::SigningKey;

use crate::access::{Actor, Authentication, Role};
use crate::approval::{
    Command, DeploymentState, Drawing, NextIds, Objections, Policy, Present, Refused, RobotLedger,
    Situation, Standing, due, step,
};

pub(super) const NOW_NS: i64 = 1_763_700_000_000_000_000;

/// Estimate that has converged on this steering offset.
pub(super) fn estimate(offset_rad: f64, second: i64) -> EstimateDocument {
    let parameter = |name: Parameter| ParameterDocument {
        value: match name {
            Parameter::SteeringOffset => offset_rad,
            Parameter::LidarX => 0.434,
            Parameter::LidarY | Parameter::LidarYaw | Parameter::TimeOffset => 0.0,
            _ => 1.0,
        },
        sigma: 0.000_2,
        unit: name.unit(),
        status: match name {
            Parameter::Wheelbase | Parameter::SteeringGain => ParameterStatus::Fixed,
            _ => ParameterStatus::Converged,
        },
        needs: None,
    };
    EstimateDocument {
        robot: RobotId::parse("tugger_01").unwrap(),
        stamp_ns: RobotTime(NOW_NS + second * 1_000_000_000),
        time_s: 100.0,
        distance_m: 80.0,
        parameters: Parameters {
            steering_offset: parameter(Parameter::SteeringOffset),
            lidar_x: parameter(Parameter::LidarX),
            lidar_y: parameter(Parameter::LidarY),
            lidar_yaw: parameter(Parameter::LidarYaw),
            speed_scale: parameter(Parameter::SpeedScale),
            wheelbase: parameter(Parameter::Wheelbase),
            time_offset: parameter(Parameter::TimeOffset),
            steering_gain: parameter(Parameter::SteeringGain),
        },
        covariance: None,
        steering_table: None,
        reassembly_open: false,
        detection: None,
        consistency: Consistency::default(),
        counts: Counts::default(),
        motions: None,
        lidar_in_base_link: None,
        estimated_by: None,
    }
}

/// Bench of one robot, which applies commands as the lifecycle does.
pub(super) struct Bench {
    pub(super) ledger: RobotLedger,
    pub(super) ids: NextIds,
    pub(super) policy: Policy,
    /// Configured pose of the rear axle.
    pub(super) rear_axle: Option<Pose2>,
    /// Document that was signed last.
    pub(super) signed: Option<CalibrationDocument>,
    /// Wall time.
    pub(super) now: WallTime,
    /// Configured drawing of the robot.
    pub(super) drawing: Option<Drawing>,
    /// Present estimate at a decision.
    pub(super) present: Present,
    /// True if the robot sends at a decision.
    pub(super) is_sending: bool,
}

impl Bench {
    pub(super) fn new() -> Self {
        Self {
            ledger: RobotLedger::new(RobotId::parse("tugger_01").unwrap()),
            ids: NextIds {
                revision: RevisionId(1),
                proposal: ProposalId(1),
                deployment: DeploymentId(1),
            },
            policy: Policy::default(),
            rear_axle: None,
            signed: None,
            now: WallTime(NOW_NS),
            drawing: Some(Drawing {
                values: nominal(),
                by: None,
            }),
            present: Present::Unknown,
            is_sending: false,
        }
    }

    pub(super) fn take(&mut self, command: Command, actor: &Actor) {
        self.try_to(command, actor).unwrap();
    }

    pub(super) fn try_to(&mut self, command: Command, actor: &Actor) -> Result<(), Refused> {
        let key = SigningKey::from_bytes(&[7; 32]);
        let standing = Standing {
            policy: &self.policy,
            key: &key,
            actor,
            now: self.now,
            frozen: false,
            rear_axle_in_base_link: self.rear_axle,
            drawing: self.drawing.clone(),
            present: self.present,
            is_sending: self.is_sending,
        };
        let outcome = step(&self.ledger, command, self.ids, &standing)?;
        self.ids.revision = self.ids.revision.next();
        self.ids.proposal = self.ids.proposal.next();
        self.ids.deployment = self.ids.deployment.next();
        if let Some((_, envelope)) = outcome.envelopes.last() {
            self.signed = Some(serde_json::from_str(&envelope.document).unwrap());
        }
        self.ledger = outcome.ledger;
        Ok(())
    }

    pub(super) fn due(
        &self,
        estimate: Option<&EstimateDocument>,
        verification: bool,
    ) -> Option<Command> {
        let situation = Situation {
            now: self.now,
            estimate: estimate.filter(|_| !verification),
            objections: Objections {
                two_senders: self.present == Present::TwoSenders,
                ..Objections::default()
            },
            stable: true,
            verification: estimate.filter(|_| verification),
            nominal: self.drawing.as_ref().map(|drawing| drawing.values),
        };
        due(&self.ledger, &situation, &self.policy)
    }

    /// Applies the command that is due by the service itself.
    pub(super) fn do_due(
        &mut self,
        estimate: &EstimateDocument,
        verification: bool,
    ) -> Option<&'static str> {
        let command = self.due(Some(estimate), verification)?;
        let name = match &command {
            Command::Propose { .. } => "propose",
            Command::Supersede { .. } => "supersede",
            Command::Refresh { .. } => "refresh",
            Command::Void { .. } => "void",
            Command::Judge { verification, .. } if verification.within => "verify",
            Command::Judge { .. } => "fail",
            _ => "another",
        };
        self.take(command, &Actor::service());
        Some(name)
    }

    pub(super) fn approve(&mut self) {
        self.approve_as("ana").unwrap();
    }

    pub(super) fn approve_as(&mut self, name: &str) -> Result<(), Refused> {
        let open = self.ledger.open.clone().unwrap();
        let command = Command::Approve {
            proposal: open.id,
            version: Some(open.version),
            sha256: open.revision_sha256,
            reason: None,
        };
        self.try_to(command, &person(name))
    }

    /// Advances the time until a proposal may be refreshed.
    pub(super) fn wait(&mut self) {
        self.now.0 += 60 * 1_000_000_000;
    }

    /// Brings the deployment under way to its verification.
    pub(super) fn try_out(&mut self) {
        let offer = self.ledger.live.clone().unwrap().offer;
        let generation = offer.generation;
        let applied = Applied {
            generation,
            sha256: offer.sha256,
            status: AppliedStatus::Applied,
            reason: None,
            applied_at_ns: RobotTime(NOW_NS),
            values: None,
        };
        self.take(Command::Offer { generation }, &Actor::service());
        self.take(Command::Acknowledge(applied), &Actor::service());
        self.take(Command::Confirmed { generation }, &Actor::service());
    }

    pub(super) fn state(&self) -> Option<DeploymentState> {
        self.ledger.live.as_ref().map(|live| live.state)
    }
}

/// Values of a robot that is built by its drawing.
pub(super) fn nominal() -> CalibrationValues {
    CalibrationValues {
        lidar_x_m: 0.434,
        ..CalibrationValues::default()
    }
}

pub(super) fn person(name: &str) -> Actor {
    Actor {
        name: name.to_owned(),
        authentication: Authentication::Session,
        role: Some(Role::Approver),
        request: None,
    }
}

/// Answer that the robot uses values of its own.
pub(super) fn factory(offset_rad: f64, at_ns: WallTime) -> Applied {
    Applied {
        generation: Generation(0),
        sha256: String::new(),
        status: AppliedStatus::Applied,
        reason: None,
        applied_at_ns: RobotTime(at_ns.0),
        values: Some(CalibrationValues {
            steering_offset_rad: offset_rad,
            lidar_x_m: 0.434,
            ..CalibrationValues::default()
        }),
    }
}
