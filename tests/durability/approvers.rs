//! Two people who approve the same proposal at once, on the real store.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use fleetcal_clock::SystemClock;
use fleetcal_domain::access::{Actor, Authentication, Role};
use fleetcal_domain::approval::{Command, Evidence, Origin, Policy, ProposalState, Refused};
use fleetcal_domain::robot::{Mount, RobotConfig, Wheelbase};
use fleetcal_estimator::{Pose2, VehicleModel};
use fleetcal_model::{ProposalId, Version, WallTime};
use fleetcal_operations::lifecycle::{Decide, Decided};
use fleetcal_operations::robots::configure;
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::CalibrationValues;
use fleetcal_proto::signing::SigningKey;
use fleetcal_store::{Expected, ProposalFilter, Store, StoreError};

use crate::durability::place::Place;
use crate::durability::records;

/// Proposals that two people approve at once.
const PROPOSALS: usize = 1_000;
/// Robots at the same time, so that some share a transaction and some do not.
const ROBOTS: usize = 20;

fn person(name: &str) -> Actor {
    Actor {
        name: name.to_owned(),
        authentication: Authentication::Session,
        role: Some(Role::Approver),
        request: None,
    }
}

async fn decide(
    store: &Store,
    robot: &RobotId,
    command: Command,
    by: &str,
) -> Result<Decided, StoreError> {
    let decision = Decide {
        release: None,
        robot: robot.clone(),
        command,
        actor: person(by),
        given_policy: Arc::new(Policy::default()),
        key: Arc::new(SigningKey::from_bytes(&[7; 32])),
        tenure: None,
        now: WallTime(1_763_700_000_000_000_000),
        idempotency: None,
        rear_axle_in_base_link: None,
        present: fleetcal_domain::approval::Present::Unknown,
        view: None,
        cross_tracks: BTreeMap::new(),
    };
    store.transact(decision).await
}

/// Stores a drawing of a robot near its changes, so that one approver suffices.
async fn draw(store: &Store, robot: &RobotId) {
    let wheelbase = Wheelbase::try_from(1.2).unwrap();
    let config = RobotConfig {
        nominal_extrinsics: Some(Mount::try_from(Pose2::new(0.434, 0.0, 0.0)).unwrap()),
        ..RobotConfig::of_vehicle(VehicleModel::Bicycle, wheelbase)
    };
    configure(store, robot, &config, Expected::Any, Actor::service())
        .await
        .unwrap();
}

async fn propose(store: &Store, robot: &RobotId) -> (u64, Command) {
    let values = CalibrationValues {
        steering_offset_rad: 0.02,
        lidar_x_m: 0.434,
        ..CalibrationValues::default()
    };
    let command = Command::Propose {
        origin: Origin::Person,
        values,
        sigmas: CalibrationValues::default(),
        evidence: Evidence::default(),
        reason: None,
    };
    let Ok(Decided::Taken(outcome)) = decide(store, robot, command, "carla").await else {
        panic!("a proposal is refused");
    };
    let proposal = outcome.proposals.last().unwrap();
    let approve = Command::Approve {
        proposal: proposal.id,
        version: Some(proposal.version),
        sha256: proposal.revision_sha256.clone(),
        reason: None,
    };
    (proposal.id.0, approve)
}

/// Runs both approvals at once; returns the winner.
async fn race(store: &Store, robot: &RobotId) -> &'static str {
    let (id, approve) = propose(store, robot).await;
    let attempt = |name: &'static str| {
        let (store, robot, approve) = (store.clone(), robot.clone(), approve.clone());
        tokio::spawn(async move { decide(&store, &robot, approve, name).await })
    };
    let (ana, bruno) = (attempt("ana"), attempt("bruno"));
    let (ana, bruno) = (ana.await.unwrap(), bruno.await.unwrap());
    let (winner, loser) = match (ana, bruno) {
        (Ok(_), Err(loser)) => ("ana", loser),
        (Err(loser), Ok(_)) => ("bruno", loser),
        other => panic!("proposal {id}: {other:?}"),
    };
    let StoreError::Refused(refused) = loser else {
        panic!("{loser}")
    };
    assert_eq!(refused, Refused::Stale { found: Version(2) });
    let (proposal, _) = store.proposal(ProposalId(id)).await.unwrap().unwrap();
    assert_eq!(proposal.state, ProposalState::Approved);
    let by: Vec<_> = proposal
        .approvals
        .iter()
        .map(|one| one.by.as_str())
        .collect();
    assert_eq!(by, [winner]);
    // Nobody has seen it yet: it is taken back, and the next one can be proposed.
    let reason = "the next one follows".to_owned();
    let withdraw = Command::RollBack {
        version: None,
        reason,
    };
    decide(store, robot, withdraw, "ana").await.unwrap();
    winner
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn of_two_approvers_at_once_exactly_one_wins() {
    let folder = tempfile::tempdir().unwrap();
    let clock = Arc::new(SystemClock::start());
    let store = fleetcal_sqlite::open(folder.path(), clock).await.unwrap();
    let mut races = tokio::task::JoinSet::new();
    for number in 0..ROBOTS {
        let store = store.clone();
        races.spawn(async move {
            let robot = RobotId::parse(&format!("tugger_{number}")).unwrap();
            draw(&store, &robot).await;
            let mut won_by_ana = 0;
            for _ in 0..PROPOSALS / ROBOTS {
                won_by_ana += usize::from(race(&store, &robot).await == "ana");
            }
            won_by_ana
        });
    }
    let won_by_ana: usize = races.join_all().await.into_iter().sum();
    let filter = ProposalFilter {
        state: Some(ProposalState::Approved),
        limit: 2_000,
        ..ProposalFilter::default()
    };
    assert_eq!(store.proposals(&filter).await.unwrap().len(), PROPOSALS);
    store.close().await.unwrap();
    let records = records::read(&Place::Folder(folder.path().to_owned()))
        .await
        .unwrap();
    let rows = records.audit.values().flatten();
    let approvals = rows.filter(|one| one.row.action == "proposal.approve");
    assert_eq!(approvals.count(), PROPOSALS);
    println!("{PROPOSALS} races, {won_by_ana} won by the first");
}

async fn snapshot(folder: &Path) -> String {
    format!(
        "{:?}",
        records::read(&Place::Folder(folder.to_owned()))
            .await
            .unwrap()
    )
}

#[tokio::test]
async fn what_is_refused_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let clock = Arc::new(SystemClock::start());
    let store = fleetcal_sqlite::open(folder.path(), clock).await.unwrap();
    let robot = RobotId::parse("tugger_1").unwrap();
    let (id, approve) = propose(&store, &robot).await;
    let Command::Approve { sha256, .. } = &approve else {
        panic!("no approval")
    };
    let with = |version, sha256: &str| Command::Approve {
        proposal: ProposalId(id),
        version: Some(version),
        sha256: sha256.to_owned(),
        reason: None,
    };
    let before = snapshot(folder.path()).await;
    let stale = decide(&store, &robot, with(Version(7), sha256), "ana").await;
    assert!(matches!(
        stale,
        Err(StoreError::Refused(Refused::Stale { found: Version(1) }))
    ));
    let other = decide(&store, &robot, with(Version(1), "ab"), "ana").await;
    assert!(matches!(
        other,
        Err(StoreError::Refused(Refused::OtherRevision { .. }))
    ));
    let own = decide(&store, &robot, with(Version(1), sha256), "carla").await;
    assert!(matches!(
        own,
        Err(StoreError::Refused(Refused::OwnProposal(_)))
    ));
    assert_eq!(snapshot(folder.path()).await, before);
    store.close().await.unwrap();
}
