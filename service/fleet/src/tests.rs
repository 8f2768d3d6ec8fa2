//! The fleet as a whole, without a network and without a database.

use fleetcal_clock::MockClock;
use fleetcal_cluster::Membership;
use fleetcal_domain::limits;
use fleetcal_domain::robot::{
    Counters, CrossTrack, HistoryEvent, Journal, RobotConfig, RobotState, RobotView,
    ServiceEventKind, WarningKind, WheelOdometrySignal, Wheelbase,
};
use fleetcal_estimator::{Calibrator, Effect, EstimatorSettings, Event, VehicleModel};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::CalibrationValues;
use fleetcal_proto::encoding::Encoding;
use fleetcal_proto::estimate::EstimateDocument;
use fleetcal_proto::event::RobotEvent;
use fleetcal_proto::ros::{
    AckermannDrive, AckermannDriveStamped, DynamicJointState, Header, InterfaceValue, RosMessage,
    Time,
};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::sync::broadcast;

use fleetcal_model::{AuditId, Generation, NoteKind, RobotTime, Stream};

use super::registry::Step;
use super::*;
mod batches;
mod checkpoints;
mod cluster;
mod compensated;
mod moves;
mod notes;
mod previews;
mod restarts;
mod senders;

use crate::live::LiveUpdate;

/// Message time at which the tests begin, ns since 1970.
const BEGIN_NS: i64 = 1_700_000_000_000_000_000;

/// Journal that keeps everything in memory.
#[derive(Debug, Default)]
struct Kept {
    history: Mutex<Vec<Arc<EstimateDocument>>>,
    events: Mutex<Vec<(RobotId, Arc<HistoryEvent>)>>,
    checkpoints: Mutex<BTreeMap<RobotId, Vec<u8>>>,
    /// Stamps of the newest messages when checkpoints were stored.
    checkpointed: Mutex<Vec<RobotTime>>,
}

impl Journal for Kept {
    fn record_history(&self, _: &RobotId, document: &Arc<EstimateDocument>) {
        self.history.lock().unwrap().push(Arc::clone(document));
    }

    fn record_event(&self, robot: &RobotId, event: &Arc<HistoryEvent>) {
        self.events
            .lock()
            .unwrap()
            .push((robot.clone(), Arc::clone(event)));
    }

    fn save_cross_track(&self, _: &RobotId, _: Generation, _: &CrossTrack) {}

    fn save_checkpoint(&self, robot: &RobotId, stamp: RobotTime, state: Vec<u8>) {
        self.checkpointed.lock().unwrap().push(stamp);
        let mut checkpoints = self.checkpoints.lock().unwrap();
        checkpoints.insert(robot.clone(), state);
    }
}

struct Bench {
    fleet: FleetHandle,
    kept: Arc<Kept>,
    clock: Arc<MockClock>,
}

fn id(name: &str) -> RobotId {
    RobotId::parse(name).unwrap()
}

fn vehicle() -> RobotConfig {
    RobotConfig::of_vehicle(VehicleModel::Bicycle, Wheelbase::try_from(1.2).unwrap())
}

fn bench_with(robots: &[&str], checkpoints: BTreeMap<RobotId, Vec<u8>>, step: Step) -> Bench {
    let robots = robots.iter().map(|name| (id(name), vehicle())).collect();
    bench_of(robots, checkpoints, step)
}

fn bench_of(
    robots: BTreeMap<RobotId, RobotConfig>,
    checkpoints: BTreeMap<RobotId, Vec<u8>>,
    step: Step,
) -> Bench {
    bench_in(&Membership::alone(), robots, checkpoints, step)
}

fn bench_in(
    membership: &Membership,
    robots: BTreeMap<RobotId, RobotConfig>,
    checkpoints: BTreeMap<RobotId, Vec<u8>>,
    step: Step,
) -> Bench {
    let kept = Arc::new(Kept::default());
    let clock = MockClock::at(BEGIN_NS);
    let setup = FleetSetup {
        clock: clock.clone(),
        journal: kept.clone(),
        estimator: EstimatorSettings::default(),
        cross_tracks: BTreeMap::new(),
        robots,
        checkpoints,
        last_heard: BTreeMap::new(),
        audited: fleetcal_model::AuditId(0),
        membership: membership.clone(),
    };
    Bench {
        fleet: FleetHandle::start_with(setup, step),
        kept,
        clock,
    }
}

fn bench(robots: &[&str]) -> Bench {
    bench_with(robots, BTreeMap::new(), Calibrator::step)
}

fn drive(number: i64) -> Vec<u8> {
    let stamp = Time::from_ns(BEGIN_NS + number * 10_000_000).unwrap();
    let drive = AckermannDrive {
        speed: 1.0,
        steering_angle: 0.1,
        ..Default::default()
    };
    AckermannDriveStamped {
        header: Header {
            stamp,
            frame_id: String::new(),
        },
        drive,
    }
    .to_cdr()
}

impl Bench {
    fn send(&self, robot: &str, stream: Stream, payload: &[u8]) {
        let bytes = || payload.to_vec();
        self.fleet
            .receive(&id(robot), stream, Encoding::Cdr, payload.len(), bytes);
    }

    fn view(&self, robot: &str) -> RobotView {
        self.fleet.robot(&id(robot)).unwrap()
    }

    fn check_accounts(&self, robot: &str) {
        let Counters {
            received,
            processed,
            dropped_wheel_odometry,
            dropped_scans,
            dropped_notes,
            refused,
            ignored,
            waiting,
            ..
        } = self.view(robot).counters;
        let dropped = dropped_wheel_odometry + dropped_scans + dropped_notes;
        assert_eq!(received, processed + dropped + refused + ignored + waiting);
    }

    async fn restored(&self, robot: &str) {
        for _ in 0..2_000 {
            if self.view(robot).estimate.is_some() {
                return;
            }
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
        panic!("{robot} shows no estimate");
    }

    /// Returns once the estimator has processed the notes up to a number.
    async fn noted(&self, robot: &str, number: AuditId) {
        for _ in 0..2_000 {
            if self.fleet.notes_taken(&id(robot)) >= Some(number) {
                return;
            }
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
        panic!(
            "{robot} has taken notes to {:?}",
            self.fleet.notes_taken(&id(robot))
        );
    }

    fn notes(&self) -> usize {
        let events = self.kept.events.lock().unwrap();
        let is_note = |event: &HistoryEvent| matches!(event, HistoryEvent::Note(_));
        events.iter().filter(|(_, event)| is_note(event)).count()
    }

    async fn worked_off(&self, robot: &str) {
        if let Some(robot) = self.fleet.fleet.find(robot) {
            robot.mailbox.wake();
        }
        for look in 0..2_100 {
            if self.view(robot).counters.waiting == 0 {
                return;
            }
            // Most is worked off at once: drives wait for their messages by the thousand.
            if look < 100 {
                tokio::task::yield_now().await;
            } else {
                tokio::time::sleep(Duration::from_millis(1)).await;
            }
        }
        panic!("{robot} still has {:?}", self.view(robot).counters);
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_bad_payload_is_refused_and_no_other_robot_notices() {
    let bench = bench(&["good", "bad"]);
    for number in 0..500 {
        bench.send("good", Stream::WheelOdometry, &drive(number));
        bench.send("bad", Stream::WheelOdometry, b"\0\x01\0\0nonsense");
        bench.send("bad", Stream::Scan, &[0xff; 300]);
        if number % 100 == 0 {
            bench.worked_off("good").await;
            bench.worked_off("bad").await;
        }
    }
    bench.worked_off("good").await;
    bench.worked_off("bad").await;
    let good = bench.view("good").counters;
    assert_eq!((good.processed, good.refused), (500, 0));
    let bad = bench.view("bad").counters;
    assert_eq!(bad.processed, 0);
    let reason = bad.last_refusal.clone().unwrap();
    assert!(
        reason.starts_with("wheel_odometry: ") || reason.starts_with("scan: "),
        "{reason}"
    );
    bench.check_accounts("bad");
    let progress = bench.fleet.progress(&id("good")).unwrap();
    assert_eq!(progress.drive_samples, 500);
    assert_eq!(progress.stamp_ns, RobotTime(BEGIN_NS + 499 * 10_000_000));
}

#[tokio::test]
async fn a_robot_is_warned_of_while_it_sends_on_a_former_key() {
    let bench = bench(&["a"]);
    let key = "fleet/a/wheel_odometry";
    let kinds = || {
        let warnings = bench.fleet.robot(&id("a")).unwrap().warnings;
        warnings.into_iter().map(|one| one.kind).collect::<Vec<_>>()
    };
    assert_eq!(kinds(), []);
    let stream = Stream::WheelOdometry;
    bench.fleet.refuse_former_key(&id("a"), stream, key);
    assert_eq!(kinds(), [WarningKind::FormerKey]);
    let counters = bench.fleet.robot(&id("a")).unwrap().counters;
    assert_eq!((counters.received, counters.refused), (1, 1));
    assert!(counters.last_refusal.unwrap().contains(key));
    bench.clock.advance(limits::FORMER_KEY_WARNED_FOR);
    assert_eq!(kinds(), []);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_payload_that_is_too_large_is_refused_unread() {
    let bench = bench(&["robot"]);
    let limit = limits::payload_bytes_max(Stream::WheelOdometry);
    bench.fleet.receive(
        &id("robot"),
        Stream::WheelOdometry,
        Encoding::Cdr,
        limit + 1,
        || panic!("a payload that is too large is copied"),
    );
    let counters = bench.view("robot").counters;
    assert_eq!((counters.received, counters.refused), (1, 1));
    assert!(
        counters
            .last_refusal
            .unwrap()
            .contains("16385 bytes, expected 16384")
    );
    assert_eq!(bench.fleet.counters().oversized, 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_hundred_joints_with_all_their_interfaces_are_taken() {
    let config: RobotConfig = serde_json::from_str(
        r#"{"model": "bicycle", "wheelbase_m": 1.2, "streams": {
            "wheel_odometry": {"topic": "dynamic_joint_states", "type": "control_msgs/msg/DynamicJointState"},
            "joints": {"steering": "joint_7_of_the_robot", "wheels": ["joint_8_of_the_robot"], "wheel_radius_m": 0.2}}}"#,
    )
    .unwrap();
    let bench = bench_of(
        BTreeMap::from([(id("a"), config)]),
        BTreeMap::new(),
        Calibrator::step,
    );
    let interfaces = InterfaceValue {
        interface_names: ["position", "velocity", "effort"]
            .map(str::to_owned)
            .to_vec(),
        values: vec![0.1, 5.0, 0.0],
    };
    let message = DynamicJointState {
        header: Header {
            stamp: Time::from_ns(BEGIN_NS).unwrap(),
            frame_id: String::new(),
        },
        joint_names: (0..100)
            .map(|number| format!("joint_{number}_of_the_robot"))
            .collect(),
        interface_values: vec![interfaces; 100],
    };
    bench.send("a", Stream::WheelOdometry, &message.to_cdr());
    bench.worked_off("a").await;
    let counters = bench.view("a").counters;
    assert_eq!((counters.processed, counters.last_refusal), (1, None));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_unknown_robot_is_unregistered_until_its_vehicle_is_given() {
    let bench = bench(&[]);
    bench.send("stranger", Stream::WheelOdometry, &drive(0));
    let view = bench.view("stranger");
    assert_eq!((view.state, view.config), (RobotState::Unregistered, None));
    assert_eq!(view.counters.ignored, 1);
    assert_eq!(
        view.connection.streams.first().map(|stream| stream.stream),
        Some(Stream::WheelOdometry)
    );
    bench.fleet.configure(&id("stranger"), vehicle()).unwrap();
    bench.send("stranger", Stream::WheelOdometry, &drive(1));
    bench.worked_off("stranger").await;
    let view = bench.view("stranger");
    assert_eq!(
        (view.counters.processed, view.state),
        (1, RobotState::Learning)
    );
    bench.check_accounts("stranger");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn strangers_are_bounded_and_make_room_when_they_are_gone() {
    let bench = bench(&["known"]);
    for number in 0..1_000 {
        bench.send(
            &format!("stranger_{number}"),
            Stream::WheelOdometry,
            &drive(0),
        );
    }
    assert_eq!(bench.fleet.ids().len(), limits::UNREGISTERED_ROBOTS_MAX + 1);
    assert_eq!(bench.fleet.counters().beyond_robots_max, 1_000 - 256);
    bench.clock.advance(Duration::from_secs(61));
    bench.send("late_stranger", Stream::WheelOdometry, &drive(0));
    assert!(bench.fleet.robot(&id("late_stranger")).is_some());
    assert_eq!(bench.fleet.ids().len(), limits::UNREGISTERED_ROBOTS_MAX + 1);
}

/// Panics on the drive sample that `drive(13)` makes.
fn panicking(calibrator: &mut Calibrator, event: Event) -> Vec<Effect> {
    if let Event::WheelOdometry(sample) = &event {
        assert_ne!(
            sample.stamp().0,
            BEGIN_NS + 13 * 10_000_000,
            "as the test wants it"
        );
    }
    calibrator.step(event)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_panicking_estimator_is_started_anew_and_then_left_alone() {
    let bench = bench_with(&["healthy", "sick"], BTreeMap::new(), panicking);
    for number in 0..12 {
        bench.send("healthy", Stream::WheelOdometry, &drive(number));
        bench.send("sick", Stream::WheelOdometry, &drive(13));
    }
    bench.worked_off("healthy").await;
    bench.worked_off("sick").await;
    assert_eq!(bench.view("healthy").counters.processed, 12);
    let sick = bench.view("sick");
    assert_eq!((sick.counters.processed, sick.counters.refused), (0, 12));
    assert_eq!(
        (sick.state, sick.estimator_restarts),
        (RobotState::Failed, 11)
    );
    assert_eq!(bench.fleet.counters().estimator_panics, 11);
    let events = bench.kept.events.lock().unwrap();
    let kinds: Vec<_> = events
        .iter()
        .filter_map(|(robot, event)| match &**event {
            HistoryEvent::Service(event) if robot.as_str() == "sick" => Some(event.kind),
            _ => None,
        })
        .collect();
    assert_eq!(kinds.last(), Some(&ServiceEventKind::EstimatorStopped));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn one_panic_costs_one_message() {
    let bench = bench_with(&["robot"], BTreeMap::new(), panicking);
    for number in 0..30 {
        bench.send("robot", Stream::WheelOdometry, &drive(number));
    }
    bench.worked_off("robot").await;
    let counters = bench.view("robot").counters;
    assert_eq!((counters.processed, counters.refused), (29, 1));
    assert_eq!(bench.view("robot").state, RobotState::Learning);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_stopped_fleet_leaves_a_state_that_another_one_goes_on_from() {
    let first = bench(&["robot"]);
    for number in 0..300 {
        first.send("robot", Stream::WheelOdometry, &drive(number));
    }
    first.fleet.stop().await;
    assert_eq!(
        first.view("robot").counters.processed,
        300,
        "what waited is worked off"
    );
    let checkpoints = first.kept.checkpoints.lock().unwrap().clone();
    assert!(checkpoints.contains_key("robot"));
    let second = bench_with(&["robot"], checkpoints.clone(), Calibrator::step);
    second.restored("robot").await;
    let kept = |bench: &Bench| bench.view("robot").estimate.unwrap().counts.drive_samples;
    assert!(
        kept(&second) >= kept(&first),
        "what was known is shown before anything comes"
    );
    for number in 300..600 {
        second.send("robot", Stream::WheelOdometry, &drive(number));
    }
    second.worked_off("robot").await;
    assert_eq!(second.view("robot").counters.refused, 0);
    // With another vehicle the stored state is worth nothing.
    let other = RobotConfig {
        wheelbase_m: Wheelbase::try_from(2.0).unwrap(),
        ..vehicle()
    };
    let robots = BTreeMap::from([(id("robot"), other)]);
    let third = bench_of(robots, checkpoints, Calibrator::step);
    third.send("robot", Stream::WheelOdometry, &drive(600));
    third.worked_off("robot").await;
    let begun_anew = |estimate: Arc<EstimateDocument>| estimate.counts.drive_samples <= 1;
    assert!(third.view("robot").estimate.is_none_or(begun_anew));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_session_ends_when_the_token_is_gone_and_all_is_worked_off() {
    let bench = bench(&["robot"]);
    bench.fleet.set_alive(&id("robot"), true);
    for number in 0..100 {
        bench.send("robot", Stream::WheelOdometry, &drive(number));
    }
    bench.worked_off("robot").await;
    let before = bench
        .view("robot")
        .estimate
        .map_or(0, |estimate| estimate.counts.drive_samples);
    assert!(before < 100, "the merger holds the last ones back");
    bench.fleet.set_alive(&id("robot"), false);
    bench.clock.advance(Duration::from_millis(600));
    for _ in 0..2_000 {
        let now = bench
            .view("robot")
            .estimate
            .map(|estimate| estimate.counts.drive_samples);
        if now == Some(100) {
            return;
        }
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    panic!(
        "the end of the session did not flush: {:?}",
        bench.view("robot").estimate
    );
}

async fn next_note(live: &mut broadcast::Receiver<LiveUpdate>) -> RobotEvent {
    loop {
        if let LiveUpdate::Event { event, .. } = live.recv().await.unwrap()
            && let HistoryEvent::Note(note) = &*event
        {
            return note.clone();
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_note_goes_to_the_history_once_wherever_it_comes_from() {
    let bench = bench(&["robot"]);
    let mut live = bench.fleet.live();
    let note = RobotEvent {
        kind: NoteKind::Reassembled,
        stamp_ns: RobotTime(BEGIN_NS),
        note: "new bracket".to_owned(),
    };
    bench.send("robot", Stream::Event, &serde_json::to_vec(&note).unwrap());
    bench.worked_off("robot").await;
    assert_eq!(bench.notes(), 1, "from the wire: kept by the fleet");
    assert_eq!(next_note(&mut live).await, note);
    let number = AuditId(1);
    bench
        .fleet
        .note(
            &id("robot"),
            Noted {
                number,
                event: note,
            },
        )
        .unwrap();
    bench.noted("robot", number).await;
    assert_eq!(bench.notes(), 1, "from the API: kept by the API");
}
