//! Takes decisions on a few robots' calibrations, through the real lifecycle and the real store, until
//! it is killed or has taken as many as it was told to. It says before and after each what it does.
//!
//! `fleetcal-decider DATABASE SEED ROBOTS DECISIONS SESSIONS power|process`

#![expect(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a process for a test, whose failure is to be seen"
)]

mod choice;
mod place;
mod said;

use std::collections::BTreeMap;
use std::io::Write;
use std::sync::Arc;

use fleetcal_clock::{SharedClock, SystemClock};
use fleetcal_domain::access::{Actor, Authentication, Role};
use fleetcal_domain::approval::{
    self, Drawing, NextIds, OutboxEntry, Outcome, Policy, Present, Standing, audited,
    nominal_values,
};
use fleetcal_domain::robot::{Mount, RobotConfig, Wheelbase};
use fleetcal_estimator::{EstimatorSettings, Pose2, VehicleModel};
use fleetcal_fleet::{FleetHandle, FleetSetup};
use fleetcal_model::{DeploymentId, ProposalId, RevisionId};
use fleetcal_operations::lifecycle::{Decided, Lifecycle, LifecycleSetup};
use fleetcal_operations::robots::configure;
use fleetcal_proto::RobotId;
use fleetcal_proto::signing::SigningKey;
use fleetcal_sqlite::Outlives;
use fleetcal_store::{Expected, StoreError};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

use place::Place;
use said::{Effect, Row, Said};

/// Order for a run.
struct Order {
    /// A folder, or the URL of a PostgreSQL.
    database: String,
    seed: u64,
    robots: usize,
    decisions: usize,
    sessions: u64,
    outlives: Outlives,
}

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [database, seed, robots, decisions, sessions, outlives] = words.as_slice() else {
        panic!("expected DATABASE SEED ROBOTS DECISIONS SESSIONS power|process");
    };
    let order = Order {
        database: database.clone(),
        seed: seed.parse().unwrap(),
        robots: robots.parse().unwrap(),
        decisions: decisions.parse().unwrap(),
        sessions: sessions.parse().unwrap(),
        outlives: match outlives.as_str() {
            "power" => Outlives::Power,
            "process" => Outlives::Process,
            other => panic!("{other} is neither power nor process"),
        },
    };
    let mut runtime = tokio::runtime::Builder::new_multi_thread();
    let runtime = runtime.worker_threads(2).enable_all().build().unwrap();
    for session in 0..order.sessions {
        runtime.block_on(run(&order, session));
    }
}

/// Writes one line at once, so that every received line is whole.
fn say(said: &Said) {
    let mut line = serde_json::to_vec(said).unwrap();
    line.push(b'\n');
    let mut out = std::io::stdout().lock();
    out.write_all(&line).unwrap();
    out.flush().unwrap();
}

async fn run(order: &Order, session: u64) {
    let clock: SharedClock = Arc::new(SystemClock::start());
    let place = Place::of(&order.database);
    let store = place
        .open(Arc::clone(&clock), order.outlives)
        .await
        .unwrap();
    let vehicle = || RobotConfig {
        nominal_extrinsics: Some(drawing()),
        ..RobotConfig::of_vehicle(VehicleModel::Bicycle, Wheelbase::try_from(1.2).unwrap())
    };
    let ids = (1..=order.robots).map(|number| RobotId::parse(&format!("tugger_{number}")).unwrap());
    let ids: Vec<_> = ids.collect();
    for id in &ids {
        configure(&store, id, &vehicle(), Expected::Any, Actor::service())
            .await
            .unwrap();
    }
    let fleet = FleetHandle::start(FleetSetup {
        clock: Arc::clone(&clock),
        journal: Arc::new(store.clone()),
        estimator: EstimatorSettings::default(),
        robots: ids.iter().map(|id| (id.clone(), vehicle())).collect(),
        cross_tracks: BTreeMap::new(),
        checkpoints: BTreeMap::new(),
        last_heard: BTreeMap::new(),
        audited: fleetcal_model::AuditId(0),
        membership: fleetcal_cluster::Membership::alone(),
    });
    let policy = Policy::default();
    let lifecycle = Lifecycle::start(LifecycleSetup {
        store: store.clone(),
        fleet: fleet.clone(),
        clock: Arc::clone(&clock),
        policy,
        keys: key().into(),
        membership: fleetcal_cluster::Membership::alone(),
    });
    let lifecycle = lifecycle.await.unwrap();
    say(&Said::Opened);
    let mut workers = tokio::task::JoinSet::new();
    for (number, robot) in ids.into_iter().enumerate() {
        let seed = order
            .seed
            .wrapping_mul(1_000)
            .wrapping_add(session * 100 + number as u64);
        let worker = Worker {
            robot,
            lifecycle: lifecycle.clone(),
            clock: Arc::clone(&clock),
            random: StdRng::seed_from_u64(seed),
        };
        workers.spawn(worker.work(order.decisions / order.robots));
    }
    while let Some(ended) = workers.join_next().await {
        ended.unwrap();
    }
    lifecycle.stop().await;
    fleet.stop().await;
    store.close().await.unwrap();
    say(&Said::Closed);
}

/// Returns the drawing of every robot: the mount of its LiDAR.
fn drawing() -> Mount {
    Mount::try_from(Pose2::new(0.425, 0.0, 0.0)).unwrap()
}

fn key() -> SigningKey {
    SigningKey::from_bytes(&[7; 32])
}

/// Decider for one robot, one decision after another.
struct Worker {
    robot: RobotId,
    lifecycle: Lifecycle,
    clock: SharedClock,
    random: StdRng,
}

impl Worker {
    async fn work(mut self, decisions: usize) {
        for _ in 0..decisions {
            let actor = self.actor();
            let ledger = self.lifecycle.ledger(&self.robot);
            let command = choice::choose(&mut self.random, &ledger, self.clock.now());
            let standing = Standing {
                policy: &self.lifecycle.policy(),
                key: &key(),
                actor: &actor,
                now: self.clock.now(),
                frozen: false,
                rear_axle_in_base_link: None,
                drawing: Some(Drawing {
                    values: nominal_values(&drawing().pose()),
                    by: None,
                }),
                present: Present::Unknown,
                is_sending: false,
            };
            // Numbers that the store gives to nothing.
            let ids = NextIds {
                revision: RevisionId(u64::MAX / 4),
                proposal: ProposalId(u64::MAX / 4),
                deployment: DeploymentId(u64::MAX / 4),
            };
            let expected = approval::step(&ledger, command.clone(), ids, &standing);
            let robot = self.robot.to_string();
            say(&Said::Tries(match &expected {
                Ok(outcome) => effect(&robot, outcome),
                Err(_) => Effect {
                    robot: robot.clone(),
                    rows: Vec::new(),
                    outbox: Vec::new(),
                    sent: None,
                },
            }));
            match self
                .lifecycle
                .decide(&self.robot, command, actor, None)
                .await
            {
                Ok(Decided::Taken(outcome)) => say(&Said::Done(effect(&robot, &outcome))),
                Err(StoreError::Refused(_)) => say(&Said::Refused { robot }),
                other => panic!("{other:?}"),
            }
        }
    }

    fn actor(&mut self) -> Actor {
        let names = ["ana", "bruno", "carla", "service"];
        match names[self.random.random_range(0..names.len())] {
            "service" => Actor::service(),
            name => Actor {
                name: name.to_owned(),
                authentication: Authentication::Session,
                role: Some(Role::Approver),
                request: None,
            },
        }
    }
}

fn effect(robot: &str, outcome: &Outcome) -> Effect {
    let entry = |entry: &OutboxEntry| match entry {
        OutboxEntry::Approved(generation) => ("approved".to_owned(), generation.0),
        OutboxEntry::Confirmed(generation) => ("confirmed".to_owned(), generation.0),
    };
    let rows = outcome.transitions.iter().map(|transition| Row {
        action: transition.action().as_str().to_owned(),
        subject: transition.action().subject().to_owned(),
        subject_id: transition.subject_id(),
        after: audited(transition).1,
    });
    Effect {
        robot: robot.to_owned(),
        rows: rows.collect(),
        outbox: outcome.outbox.iter().map(entry).collect(),
        sent: outcome.sent.as_ref().map(entry),
    }
}
