//! Lifecycle on the real store and the real fleet, with a clock that the tests control.

mod certificates;
mod driven;
mod requests;
mod restarts;
mod retirement;
mod return_journeys;
mod robots;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use fleetcal_clock::{Clock, MockClock};
use fleetcal_contract::TestDatabase;
use fleetcal_domain::access::{Actor, Authentication, Role};
use fleetcal_domain::approval::{
    Command, Deployment, DeploymentState, Evidence, Origin, Outcome, Policy, ProposalState,
    Refused, Tolerance, Verification,
};
use fleetcal_domain::robot::{Mount, RobotConfig, Wheelbase};
use fleetcal_estimator::{EstimatorSettings, Pose2, VehicleModel};
use fleetcal_fleet::{FleetHandle, FleetSetup};
use fleetcal_model::{Generation, RobotTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::{Applied, AppliedStatus, CalibrationDocument, CalibrationValues};
use fleetcal_proto::signing::{SigningKey, TrustedKeys};
use fleetcal_store::{EventKind, EventRecord, Expected, Store, StoreError};

use super::{Decided, Lifecycle, LifecycleSetup, OutboxMessage, SetFreeze, SetPolicy};
use crate::robots::configure;

const HOUR: Duration = Duration::from_hours(1);

/// Service without its link and its API.
struct Bench {
    database: TestDatabase,
    clock: Arc<MockClock>,
    policy: Policy,
    store: Store,
    fleet: FleetHandle,
    lifecycle: Lifecycle,
}

fn robot() -> RobotId {
    RobotId::parse("tugger_01").unwrap()
}

fn person(name: &str) -> Actor {
    Actor {
        name: name.to_owned(),
        authentication: Authentication::Session,
        role: Some(Role::Approver),
        request: None,
    }
}

fn values(steering_offset_rad: f64) -> CalibrationValues {
    CalibrationValues {
        steering_offset_rad,
        lidar_x_m: 0.434,
        ..CalibrationValues::default()
    }
}

fn vehicle() -> RobotConfig {
    let wheelbase = Wheelbase::try_from(1.2).unwrap();
    RobotConfig::of_vehicle(VehicleModel::Bicycle, wheelbase)
}

impl Bench {
    async fn open(policy: Policy) -> Self {
        let database = TestDatabase::new().await;
        let clock = MockClock::at(1_763_700_000_000_000_000);
        Self::open_in(database, clock, policy).await
    }

    async fn open_in(database: TestDatabase, clock: Arc<MockClock>, policy: Policy) -> Self {
        let store = database.open(clock.clone()).await;
        let stored = store.load_checkpoints().await.unwrap();
        let stored = stored
            .into_iter()
            .map(|record| (record.robot, record.state));
        let fleet = FleetHandle::start(FleetSetup {
            clock: clock.clone(),
            journal: Arc::new(store.clone()),
            estimator: EstimatorSettings::default(),
            robots: BTreeMap::from([(robot(), vehicle())]),
            cross_tracks: BTreeMap::new(),
            checkpoints: stored.collect(),
            last_heard: BTreeMap::new(),
            audited: fleetcal_model::AuditId(0),
            membership: fleetcal_cluster::Membership::alone(),
        });
        let lifecycle = Lifecycle::start(LifecycleSetup {
            store: store.clone(),
            fleet: fleet.clone(),
            clock: clock.clone(),
            policy,
            keys: SigningKey::from_bytes(&[7; 32]).into(),
            membership: fleetcal_cluster::Membership::alone(),
        });
        let lifecycle = lifecycle.await.unwrap();
        Self {
            database,
            clock,
            policy,
            store,
            fleet,
            lifecycle,
        }
    }

    /// Stops the service and starts it again on its stored records.
    async fn restart(self) -> Self {
        self.lifecycle.stop().await;
        self.fleet.stop().await;
        self.store.close().await.unwrap();
        drop((self.lifecycle, self.fleet, self.store));
        Self::open_in(self.database, self.clock, self.policy).await
    }

    async fn take(&self, command: Command, actor: Actor) -> Result<Outcome, Refused> {
        match self.lifecycle.decide(&robot(), command, actor, None).await {
            Ok(Decided::Taken(outcome)) => Ok(*outcome),
            Err(StoreError::Refused(refused)) => Err(refused),
            other => panic!("{other:?}"),
        }
    }

    async fn propose(&self, offset_rad: f64, nominal: Option<CalibrationValues>) {
        self.propose_values(values(offset_rad), nominal).await;
    }

    async fn propose_values(&self, values: CalibrationValues, nominal: Option<CalibrationValues>) {
        self.draw(nominal, Actor::service()).await;
        let command = Command::Propose {
            origin: Origin::Estimator,
            values,
            sigmas: CalibrationValues::default(),
            evidence: Evidence::default(),
            reason: None,
        };
        self.take(command, Actor::service()).await.unwrap();
    }

    /// Sets or removes the robot's drawing; the service itself acts for the configuration file.
    async fn draw(&self, nominal: Option<CalibrationValues>, actor: Actor) {
        let place = |values: CalibrationValues| {
            Pose2::new(values.lidar_x_m, values.lidar_y_m, values.lidar_yaw_rad)
        };
        let drawing = nominal.map(|values| Mount::try_from(place(values)).unwrap());
        let config = RobotConfig {
            nominal_extrinsics: drawing,
            ..vehicle()
        };
        configure(&self.store, &robot(), &config, Expected::Any, actor)
            .await
            .unwrap();
    }

    fn approval(&self) -> Command {
        let open = self.lifecycle.ledger(&robot()).open.clone().unwrap();
        Command::Approve {
            proposal: open.id,
            version: Some(open.version),
            sha256: open.revision_sha256,
            reason: None,
        }
    }

    /// Approves the open proposal as the required number of people.
    async fn agree(&self) {
        self.take(self.approval(), person("ana")).await.unwrap();
        if self.lifecycle.ledger(&robot()).open.is_some() {
            self.take(self.approval(), person("bruno")).await.unwrap();
        }
    }

    /// Proposes and approves.
    async fn approve(&self, offset_rad: f64, nominal: Option<CalibrationValues>) {
        self.propose(offset_rad, nominal).await;
        self.agree().await;
    }

    /// Sends all messages that may be sent, as the link does; returns them.
    async fn send_outbox(&self) -> Vec<OutboxMessage> {
        let mut sent = Vec::new();
        for (robot, entry) in self.lifecycle.outbox().await.unwrap() {
            if let Some(message) = self.lifecycle.message(&robot, entry).await.unwrap() {
                self.lifecycle.sent(&robot, entry).await.unwrap();
                sent.push(message);
            }
        }
        sent
    }

    /// Document in the answer to the robot's request.
    async fn asked(&self) -> Option<CalibrationDocument> {
        let trusted = TrustedKeys::new(vec![self.lifecycle.public_key()]).unwrap();
        let offered = self.lifecycle.approved(&robot(), None).await.unwrap();
        offered.map(|offered| offered.envelope.open(&trusted).unwrap())
    }

    /// Answer of the robot about a generation that was sent.
    async fn answer(&self, generation: Generation, status: AppliedStatus) -> Result<(), Refused> {
        let envelope = self.store.envelope(&robot(), generation).await.unwrap();
        let applied = Applied {
            generation,
            sha256: envelope.map(|one| one.sha256).unwrap_or_default(),
            status,
            reason: None,
            applied_at_ns: RobotTime(self.clock.now().0),
            values: None,
        };
        let actor = Actor::robot(&robot());
        match self.lifecycle.acknowledge(&robot(), applied, actor).await {
            Ok(()) => Ok(()),
            Err(StoreError::Refused(refused)) => Err(refused),
            Err(other) => panic!("{other}"),
        }
    }

    /// Brings an approved proposal to the robot's verification.
    async fn drive_in_verification(&self) -> Generation {
        let generation = self.asked().await.unwrap().generation;
        self.send_outbox().await;
        self.answer(generation, AppliedStatus::Applied)
            .await
            .unwrap();
        self.send_outbox().await;
        assert_eq!(self.state(), Some(DeploymentState::Verifying));
        generation
    }

    /// Answers as the robot that it has applied a generation, and sends it the confirmation.
    async fn applies(&self, generation: Generation) {
        self.answer(generation, AppliedStatus::Applied)
            .await
            .unwrap();
        assert!(is_confirmation_of(&self.send_outbox().await, generation));
    }

    async fn verify(&self, within: bool) -> Outcome {
        let deployment = self.lifecycle.ledger(&robot()).live.clone().unwrap().id;
        let verification = Verification {
            at_ns: self.clock.now(),
            distance_m: 80.0,
            residual: [0.0; 4],
            sigma: [0.0; 4],
            within,
            limits: None,
            evidence: None,
        };
        let command = Command::Judge {
            deployment,
            verification,
        };
        self.take(command, Actor::service()).await.unwrap()
    }

    async fn roll_back(&self) -> Result<Outcome, Refused> {
        let command = Command::RollBack {
            version: None,
            reason: "it weaves".to_owned(),
        };
        self.take(command, person("ana")).await
    }

    /// Lets the lifecycle apply due commands.
    async fn look(&self) {
        self.lifecycle.look().await;
    }

    /// State of the deployment under way.
    fn state(&self) -> Option<DeploymentState> {
        self.lifecycle
            .ledger(&robot())
            .live
            .as_ref()
            .map(|live| live.state)
    }

    /// State of every approved proposal's deployment, oldest first.
    async fn followed(&self) -> Vec<DeploymentState> {
        let deployments = self.store.deployments(&robot(), None, 100).await.unwrap();
        let proposals: Vec<_> = deployments.iter().filter_map(|one| one.proposal).collect();
        let followed = self.store.followed(&proposals).await.unwrap();
        followed.into_values().collect()
    }

    /// Latest deployment, ended or not.
    async fn latest(&self) -> Deployment {
        let deployments = self.store.deployments(&robot(), None, 1).await.unwrap();
        deployments.into_iter().next().unwrap()
    }

    /// Generation in use by the records.
    fn used(&self) -> Option<Generation> {
        let ledger = self.lifecycle.ledger(&robot());
        ledger
            .shadow
            .in_use
            .as_ref()
            .map(|in_use| in_use.generation)
    }

    /// History of the robot, newest first.
    async fn events(&self) -> Vec<EventRecord> {
        self.store.events(&robot(), None, 100).await.unwrap()
    }

    async fn rows(&self) -> usize {
        let filter = fleetcal_store::AuditFilter {
            limit: 10_000,
            ..Default::default()
        };
        self.store.audit(&filter).await.unwrap().len()
    }
}

fn is_confirmation_of(messages: &[OutboxMessage], generation: Generation) -> bool {
    let mut confirmations = messages.iter().filter_map(|message| match message {
        OutboxMessage::Confirmed(confirmed) => Some(confirmed.generation),
        OutboxMessage::Approved(_) => None,
    });
    confirmations.next() == Some(generation)
}
