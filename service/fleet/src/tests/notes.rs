//! Notes of people and robots: whatever happens meanwhile, the estimator takes what it was said to have.

use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

use super::*;

const ROBOT: &str = "robot";

/// Disturbance after a note is stored.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Meanwhile {
    /// The robot continues.
    Nothing,
    /// The robot sends nothing more.
    Silence,
    /// The service stops in order, and starts again.
    Restart,
    /// The service is killed, and starts again from the last stored state.
    Kill,
    /// The estimator panics on a message, and restarts from the stored state.
    Panic,
    /// The robot's configuration is changed.
    Configured,
    /// A second sender uses the robot's id.
    TwoSenders,
}

const ALL: [Meanwhile; 7] = [
    Meanwhile::Nothing,
    Meanwhile::Silence,
    Meanwhile::Restart,
    Meanwhile::Kill,
    Meanwhile::Panic,
    Meanwhile::Configured,
    Meanwhile::TwoSenders,
];

/// A note at a random instant, with a random stamp, beside a disturbance.
struct Instant {
    chance: StdRng,
    bench: Bench,
    /// Stored notes, as in the audit.
    stored: Vec<Noted>,
    sent: i64,
    /// True if the history showed a note when the service was killed.
    was_shown: bool,
}

impl Instant {
    fn new(seed: u64) -> Self {
        Self {
            chance: StdRng::seed_from_u64(seed),
            bench: bench_with(&[ROBOT], BTreeMap::new(), panicking),
            stored: Vec::new(),
            sent: 100,
            was_shown: false,
        }
    }

    /// Sends some messages, faster than the task processes them; the one that the estimator panics
    /// on is not among them.
    fn send(&mut self, most: i64) {
        for _ in 0..self.chance.random_range(0..=most) {
            self.bench
                .send(ROBOT, Stream::WheelOdometry, &drive(self.sent));
            self.sent += 1;
        }
    }

    fn note(&mut self) -> RobotEvent {
        let now_ns = BEGIN_NS + self.sent * 10_000_000;
        let estimate = self.bench.view(ROBOT).estimate;
        let stamp_ns = match self.chance.random_range(0..5) {
            0 => estimate.map_or(now_ns, |estimate| estimate.stamp_ns.0),
            1 => now_ns,
            2 => now_ns - 3_600_000_000_000,
            3 => now_ns + 86_400_000_000_000,
            _ => 7,
        };
        RobotEvent {
            kind: NoteKind::Reassembled,
            stamp_ns: RobotTime(stamp_ns),
            note: String::new(),
        }
    }

    /// Passes on the notes of robots that request them, as the service does.
    fn bring(&self) {
        let Some(taken) = self.bench.fleet.notes_taken(&id(ROBOT)) else {
            return;
        };
        for noted in self.stored.iter().filter(|noted| noted.number > taken) {
            drop(self.bench.fleet.note(&id(ROBOT), noted.clone()));
        }
    }

    /// Continues from the stored state.
    async fn start_again(&mut self) {
        // In this order: the state with a note is stored before the history shows it.
        self.was_shown = self.bench.notes() > 0;
        let checkpoints = self.bench.kept.checkpoints.lock().unwrap().clone();
        let before = std::mem::replace(
            &mut self.bench,
            bench_with(&[ROBOT], checkpoints, panicking),
        );
        // A killed service writes nothing more; its tasks only have to end.
        before.fleet.stop().await;
    }

    async fn happen(&mut self, meanwhile: Meanwhile) {
        match meanwhile {
            Meanwhile::Nothing | Meanwhile::Silence => {}
            Meanwhile::Restart => {
                self.bench.fleet.stop().await;
                self.start_again().await;
            }
            Meanwhile::Kill => self.start_again().await,
            Meanwhile::Panic => self.bench.send(ROBOT, Stream::WheelOdometry, &drive(13)),
            Meanwhile::Configured => {
                let config = RobotConfig {
                    nominal_extrinsics: None,
                    ..RobotConfig::of_vehicle(
                        VehicleModel::Bicycle,
                        Wheelbase::try_from(1.3).unwrap(),
                    )
                };
                self.bench.fleet.configure(&id(ROBOT), config).unwrap();
            }
            Meanwhile::TwoSenders => {
                for _ in 0..40 {
                    let message = drive(self.sent);
                    self.bench.send_from(self.sent as u64 % 2, &message);
                    self.sent += 1;
                }
            }
        }
        if meanwhile != Meanwhile::Silence {
            self.send(30);
        }
    }

    /// True if the estimator registers the reassembly within a bounded time.
    async fn is_known(&self) -> bool {
        for _ in 0..3_000 {
            if self.bench.fleet.wants_notes(&id(ROBOT)) {
                self.bring();
            }
            let view = self.bench.view(ROBOT);
            // What people see agrees with it.
            let shown = view
                .estimate
                .is_none_or(|estimate| estimate.reassembly_open);
            if view.reassembly_open && shown && view.counters.waiting == 0 {
                return true;
            }
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
        false
    }
}

/// Sends 200 notes at random instants of driving, overload and silence, before the first message,
/// beside restarts, kills and faults: each reaches the estimator, or is refused at once.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_note_is_acknowledged_and_lost() {
    let mut refused = 0;
    for seed in 0..200 {
        let mut instant = Instant::new(seed);
        let meanwhile = ALL[instant.chance.random_range(0..ALL.len())];
        let most = [0, 5, 100, 2_000][instant.chance.random_range(0..4)];
        instant.send(most);
        if instant.chance.random_bool(0.5) {
            instant.bench.worked_off(ROBOT).await;
        }
        let note = instant.note();
        let by_person = instant.chance.random_bool(0.5);
        if by_person {
            instant.bench.fleet.takes_notes(&id(ROBOT)).unwrap();
            instant.stored.push(Noted {
                number: AuditId(1),
                event: note,
            });
            // The service may be killed between its answer and this.
            if meanwhile != Meanwhile::Kill || instant.chance.random_bool(0.5) {
                instant.bring();
            }
        } else {
            let payload = serde_json::to_vec(&note).unwrap();
            instant.bench.send(ROBOT, Stream::Event, &payload);
        }
        if instant.chance.random_bool(0.3) {
            instant.send(200);
        }
        instant.happen(meanwhile).await;
        // What no history shows when the service is killed, nobody was told is there.
        let is_acknowledged = by_person || meanwhile != Meanwhile::Kill || instant.was_shown;
        if !is_acknowledged {
            refused += 1;
            continue;
        }
        assert!(
            instant.is_known().await,
            "seed {seed}, {meanwhile:?}, by person {by_person}: {:?}",
            instant.bench.view(ROBOT),
        );
        instant.bench.check_accounts(ROBOT);
    }
    assert!(refused < 40, "{refused} of 200 were not acknowledged");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_note_without_an_estimator_or_room_is_refused_at_once() {
    let bench = bench(&[]);
    let noted = |number| Noted {
        number: AuditId(number),
        event: RobotEvent {
            kind: NoteKind::Reassembled,
            stamp_ns: RobotTime(7),
            note: String::new(),
        },
    };
    let unknown = FleetRefused::UnknownRobot(id(ROBOT));
    assert_eq!(bench.fleet.takes_notes(&id(ROBOT)), Err(unknown));
    bench.send(ROBOT, Stream::WheelOdometry, &drive(0));
    let unregistered = FleetRefused::Unregistered(id(ROBOT));
    assert_eq!(bench.fleet.takes_notes(&id(ROBOT)), Err(unregistered));
    let robot = bench.fleet.fleet.find(ROBOT).unwrap();
    for number in 0..limits::MAILBOX_NOTES_MAX {
        assert!(robot.mailbox.push_note(noted(number as i64)));
    }
    assert!(!robot.mailbox.has_room_for_note());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn notes_with_one_stamp_are_both_taken_and_each_once() {
    let bench = bench(&[ROBOT]);
    bench.send(ROBOT, Stream::WheelOdometry, &drive(0));
    bench.worked_off(ROBOT).await;
    let event = |kind| RobotEvent {
        kind,
        stamp_ns: RobotTime(BEGIN_NS),
        note: String::new(),
    };
    for kind in [NoteKind::PowerOn, NoteKind::Reassembled] {
        let payload = serde_json::to_vec(&event(kind)).unwrap();
        bench.send(ROBOT, Stream::Event, &payload);
    }
    bench.worked_off(ROBOT).await;
    assert_eq!(bench.notes(), 2);
    assert!(bench.view(ROBOT).estimate.unwrap().reassembly_open);
    let counters = bench.view(ROBOT).counters;
    assert_eq!((counters.processed, counters.refused), (3, 0));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_open_reassembly_is_shown_after_another_configuration_before_any_message() {
    let bench = bench(&[ROBOT]);
    bench.send(ROBOT, Stream::WheelOdometry, &drive(0));
    let event = RobotEvent {
        kind: NoteKind::Reassembled,
        stamp_ns: RobotTime(BEGIN_NS),
        note: String::new(),
    };
    let payload = serde_json::to_vec(&event).unwrap();
    bench.send(ROBOT, Stream::Event, &payload);
    bench.worked_off(ROBOT).await;
    let configured = bench.fleet.configure(&id(ROBOT), with_wheelbase(1.3));
    configured.unwrap();
    let is_shown = || {
        let view = bench.view(ROBOT);
        view.estimate.is_none() && view.reassembly_open
    };
    for _ in 0..1_000 {
        if is_shown() {
            break;
        }
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    // It stays so: the task has begun again by then.
    tokio::time::sleep(Duration::from_millis(50)).await;
    assert!(is_shown(), "{:?}", bench.view(ROBOT));
}

fn with_wheelbase(wheelbase_m: f64) -> RobotConfig {
    let wheelbase = Wheelbase::try_from(wheelbase_m).unwrap();
    RobotConfig::of_vehicle(VehicleModel::Bicycle, wheelbase)
}

/// Begins again from stored states with a robot of another wheelbase.
async fn begun_with_wheelbase(wheelbase_m: f64, from: &Bench) -> Bench {
    let checkpoints = from.kept.checkpoints.lock().unwrap().clone();
    let robots = BTreeMap::from([(id(ROBOT), with_wheelbase(wheelbase_m))]);
    let bench = bench_of(robots, checkpoints, Calibrator::step);
    bench.noted(ROBOT, AuditId(0)).await;
    bench
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn notes_outlast_another_configuration_and_a_restart_of_a_silent_robot() {
    let first = bench(&[ROBOT]);
    let number = AuditId(7);
    let event = RobotEvent {
        kind: NoteKind::Reassembled,
        stamp_ns: RobotTime(BEGIN_NS),
        note: String::new(),
    };
    let noted = Noted { number, event };
    first.fleet.note(&id(ROBOT), noted).unwrap();
    first.noted(ROBOT, number).await;
    let edited_offline = begun_with_wheelbase(1.3, &first).await;

    let is_stored = || !first.kept.checkpoints.lock().unwrap().is_empty();
    first.kept.checkpoints.lock().unwrap().clear();
    let configured = first.fleet.configure(&id(ROBOT), with_wheelbase(1.4));
    assert!(matches!(configured, Ok(Configured::BeginsAgain(_))));
    for _ in 0..2_000 {
        if is_stored() {
            break;
        }
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    let killed = begun_with_wheelbase(1.4, &first).await;
    for (bench, what) in [(edited_offline, "edited offline"), (killed, "killed")] {
        assert!(bench.view(ROBOT).reassembly_open, "{what}");
        assert_eq!(bench.fleet.notes_taken(&id(ROBOT)), Some(number), "{what}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_note_about_a_robot_whose_estimator_has_stopped_is_refused() {
    let bench = bench_with(&[ROBOT], BTreeMap::new(), panicking);
    for _ in 0..12 {
        bench.send(ROBOT, Stream::WheelOdometry, &drive(13));
    }
    bench.worked_off(ROBOT).await;
    assert_eq!(bench.view(ROBOT).state, RobotState::Failed);
    let refused = bench.fleet.takes_notes(&id(ROBOT)).unwrap_err();
    assert!(refused.to_string().contains("is stopped"), "{refused}");
}
