//! Several instances: robots begin and end here one by one, and those of others are mirrored.

use std::collections::BTreeSet;

use fleetcal_cluster::{ClaimId, Epoch, Incarnation, InstanceId, Membership, Seat, Tenure};
use fleetcal_domain::robot::{CheckFinding, CheckState, ChecksReport};
use fleetcal_proto::estimate::EstimatedBy;

use super::*;

/// One instance, with a clock of its own.
pub(super) struct Instance {
    pub bench: Bench,
    pub name: InstanceId,
    pub membership: Membership,
}

impl Instance {
    pub fn new(name: &str, robots: &[&str]) -> Self {
        let robots = robots.iter().map(|name| (id(name), vehicle())).collect();
        Self::of(name, robots)
    }

    pub fn of(name: &str, robots: BTreeMap<RobotId, RobotConfig>) -> Self {
        Self::stepping(name, robots, Calibrator::step)
    }

    /// Makes an instance with another estimator step.
    pub fn stepping(name: &str, robots: BTreeMap<RobotId, RobotConfig>, step: Step) -> Self {
        let name = InstanceId::parse(name).unwrap();
        let membership = Membership::of(name.clone());
        Self {
            bench: bench_in(&membership, robots, BTreeMap::new(), step),
            name,
            membership,
        }
    }

    fn seat(&self) -> Seat {
        Seat {
            instance: self.name.clone(),
            incarnation: Incarnation(1),
        }
    }

    /// Adopts a robot by its present rows.
    pub fn adopt(&self, robot: &str, epoch: i64, stored: Option<Vec<u8>>) {
        let cluster = self.membership.cluster().unwrap();
        cluster.began(Tenure {
            robot: id(robot),
            seat: self.seat(),
            epoch: Epoch(epoch),
            claim: ClaimId(epoch),
        });
        self.bench.fleet.adopt(&id(robot), stored);
    }

    /// Releases a robot and returns its stored state.
    pub async fn release(&self, robot: &str, keep: Keep) -> Option<Vec<u8>> {
        self.bench.fleet.release(&id(robot), keep).await;
        self.membership.cluster().unwrap().ended(&id(robot));
        let stored = self.bench.kept.checkpoints.lock().unwrap();
        stored.get(&id(robot)).cloned()
    }

    /// Sends the reports on its robots to another instance.
    fn tell(&self, other: &Self, told: &mut Reported) -> usize {
        let reports = self.bench.fleet.reports(told);
        let count = reports.len();
        for message in Digest::messages(&reports).unwrap() {
            let digest = Digest::read(&message).unwrap();
            other.bench.fleet.take_reports(&self.name, digest.reports);
        }
        count
    }
}

/// Finding that names a cause.
fn wrong_sign() -> CheckFinding {
    CheckFinding {
        check: "steering".to_owned(),
        state: CheckState::Wrong,
        cause: Some("steering_sign".to_owned()),
        seen: "steering and yaw rate have opposite signs".to_owned(),
        advice: Some("Set steering_gear = -1.".to_owned()),
        after_m: Some(17.0),
        after_s: Some(18.0),
        spoils_values: true,
    }
}

async fn drives(bench: &Bench, robot: &str, numbers: std::ops::Range<i64>) {
    for number in numbers {
        bench.send(robot, Stream::WheelOdometry, &drive(number));
        if number % 100 == 0 {
            bench.worked_off(robot).await;
        }
    }
    bench.worked_off(robot).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_instance_has_the_robots_that_it_adopts_and_no_others() {
    let a = Instance::new("a", &["robot", "other"]);
    let fleet = &a.bench.fleet;
    assert_eq!(fleet.heard(), Some(BTreeSet::new()));
    a.bench.send("robot", Stream::WheelOdometry, &drive(0));
    assert_eq!(
        a.bench.view("robot").counters.received,
        0,
        "it is another's"
    );
    a.adopt("robot", 7, None);
    assert_eq!(fleet.heard(), Some(BTreeSet::from([id("robot")])));
    drives(&a.bench, "robot", 0..300).await;
    drives(&a.bench, "other", 0..300).await;
    assert_eq!(a.bench.view("robot").counters.processed, 300);
    assert_eq!(a.bench.view("other").counters.received, 0);
    let by = a.bench.view("robot").estimated_by;
    let (instance, epoch) = ("a".to_owned(), 7);
    assert_eq!(by, Some(EstimatedBy { instance, epoch }));
    // Of another one the configuration is taken note of, and no task begins.
    let longer = RobotConfig {
        wheelbase_m: Wheelbase::try_from(1.3).unwrap(),
        ..vehicle()
    };
    fleet.configure(&id("other"), longer.clone()).unwrap();
    assert_eq!(a.bench.view("other").config, Some(longer));
    assert!(a.bench.fleet.tap(&id("other")).is_err());
    assert_eq!(a.bench.fleet.top_view(&id("other")).await, Ok(None));
    let stored = a.release("robot", Keep::State).await;
    assert!(stored.is_some());
    assert_eq!(fleet.heard(), Some(BTreeSet::new()));
    drives(&a.bench, "robot", 300..310).await;
    assert_eq!(a.bench.view("robot").counters.received, 300);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_was_lost_is_not_stored() {
    let a = Instance::new("a", &["robot"]);
    a.adopt("robot", 1, None);
    drives(&a.bench, "robot", 0..300).await;
    let before = a.bench.kept.checkpointed.lock().unwrap().len();
    a.release("robot", Keep::Nothing).await;
    assert_eq!(a.bench.kept.checkpointed.lock().unwrap().len(), before);
    a.bench.check_accounts("robot");
    // It can come back.
    a.adopt("robot", 3, None);
    drives(&a.bench, "robot", 300..400).await;
    assert_eq!(a.bench.view("robot").counters.processed, 400);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_robot_may_be_adopted_before_its_configuration_is_known() {
    let a = Instance::new("a", &[]);
    a.bench.fleet.hear(&[id("robot")]);
    a.bench.send("robot", Stream::WheelOdometry, &drive(0));
    a.adopt("robot", 1, None);
    a.bench.send("robot", Stream::WheelOdometry, &drive(1));
    a.bench.fleet.configure(&id("robot"), vehicle()).unwrap();
    a.bench.worked_off("robot").await;
    assert_eq!(a.bench.view("robot").counters.processed, 2);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_subscription_is_waited_for() {
    let a = Instance::new("a", &["robot"]);
    let mut changes = a.bench.fleet.heard_changed();
    a.bench.fleet.hear(&[id("robot")]);
    assert!(changes.has_changed().unwrap());
    changes.mark_unchanged();
    a.bench.fleet.hear(&[id("robot")]);
    assert!(!changes.has_changed().unwrap(), "it hears it already");
    let robot = id("robot");
    let stands = a.bench.fleet.subscribed(&robot);
    let soon = tokio::time::timeout(Duration::from_millis(20), stands);
    assert!(soon.await.is_err(), "nothing is subscribed to");
    a.bench.fleet.set_subscribed(a.bench.fleet.heard().unwrap());
    a.bench.fleet.subscribed(&robot).await;
    a.bench.fleet.unhear(&[id("robot")]);
    assert!(changes.has_changed().unwrap());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn every_instance_shows_every_robot() {
    let (a, b) = (
        Instance::new("a", &["robot"]),
        Instance::new("b", &["robot"]),
    );
    let mut live = b.bench.fleet.live();
    let mut told = Reported::default();
    a.bench.fleet.reports(&mut told);
    a.adopt("robot", 3, None);
    drives(&a.bench, "robot", 0..500).await;
    let note = RobotEvent {
        kind: NoteKind::Maintenance,
        stamp_ns: RobotTime(BEGIN_NS),
        note: "greased".to_owned(),
    };
    let payload = serde_json::to_vec(&note).unwrap();
    a.bench.send("robot", Stream::Event, &payload);
    a.bench.worked_off("robot").await;
    let sound = a.bench.view("robot").checks;
    assert!(!sound.streams.is_empty() && sound.named().next().is_none());
    let wrong = a.bench.fleet.fleet.find("robot").unwrap();
    wrong.set_checks(ChecksReport {
        findings: [vec![wrong_sign()], sound.findings.clone()].concat(),
        ..sound.as_ref().clone()
    });
    assert_eq!(a.tell(&b, &mut told), 1);
    let (own, mirrored) = (a.bench.view("robot"), b.bench.view("robot"));
    assert_eq!(own.estimate, mirrored.estimate);
    assert!(own.estimate.is_some());
    // The streams and what is not wrong are asked for at the robot's instance.
    assert_eq!(mirrored.checks.findings, [wrong_sign()]);
    assert!(own.checks.findings.len() > 1);
    let checks = Arc::clone(&mirrored.checks);
    assert_eq!(RobotView { checks, ..own }, mirrored, "all that is shown");
    let mut heard = (0, 0);
    while let Ok(update) = live.try_recv() {
        match update {
            LiveUpdate::Estimate { robot, .. } if robot == id("robot") => heard.0 += 1,
            LiveUpdate::Event { event, .. } if *event == HistoryEvent::Note(note.clone()) => {
                heard.1 += 1;
            }
            _ => {}
        }
    }
    assert_eq!(heard, (1, 1));
    // What has not changed is not told again, until all is.
    assert_eq!(a.tell(&b, &mut told), 0);
    a.bench.clock.advance(limits::REPORT_WHOLE_EVERY);
    assert_eq!(a.tell(&b, &mut told), 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_mirror_is_stale_when_nothing_is_told_of_it() {
    let (a, b) = (
        Instance::new("a", &["robot"]),
        Instance::new("b", &["robot"]),
    );
    let mut told = Reported::default();
    a.adopt("robot", 3, None);
    drives(&a.bench, "robot", 0..300).await;
    a.tell(&b, &mut told);
    assert!(!b.bench.view("robot").connection.stale);
    b.bench.clock.advance(limits::REPORTS_STALE_AFTER);
    assert!(b.bench.view("robot").connection.stale);
    a.bench.clock.advance(Duration::from_secs(1));
    drives(&a.bench, "robot", 300..310).await;
    a.tell(&b, &mut told);
    assert!(!b.bench.view("robot").connection.stale);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_an_instance_says_that_was_replaced_is_left_out() {
    let robots = ["robot"];
    let [a, b, c] = ["a", "b", "c"].map(|name| Instance::new(name, &robots));
    let (mut of_a, mut of_b) = (Reported::default(), Reported::default());
    a.adopt("robot", 3, None);
    drives(&a.bench, "robot", 0..300).await;
    a.tell(&c, &mut of_a);
    b.adopt("robot", 4, None);
    drives(&b.bench, "robot", 0..500).await;
    b.tell(&c, &mut of_b);
    let estimated_by = || c.bench.view("robot").estimated_by.unwrap().instance;
    assert_eq!(estimated_by(), "b");
    let shown = c.bench.view("robot").estimate;
    drives(&a.bench, "robot", 300..900).await;
    assert_eq!(a.tell(&c, &mut of_a), 1, "it does not know yet");
    assert_eq!(estimated_by(), "b");
    assert_eq!(c.bench.view("robot").estimate, shown);
    // Nor does who estimates it listen to another one.
    a.tell(&b, &mut Reported::default());
    assert_eq!(b.bench.view("robot").counters.processed, 500);
}

#[test]
fn digests_are_cut_into_messages_of_bounded_size() {
    let text = "x".repeat(900);
    let report = |number: usize| RobotReport {
        robot: id(&format!("robot_{number}")),
        epoch: Epoch(1),
        state: RobotState::Learning,
        stale: false,
        last_seen_ns: None,
        estimate: None,
        notes_taken: None,
        details: None,
        events: vec![HistoryEvent::Note(RobotEvent {
            kind: NoteKind::Maintenance,
            stamp_ns: RobotTime(7),
            note: text.clone(),
        })],
    };
    let reports: Vec<_> = (0..1_000).map(report).collect();
    let messages = Digest::messages(&reports).unwrap();
    assert!(messages.len() > 3);
    let longest = messages.iter().map(Vec::len).max().unwrap();
    assert!(longest <= limits::DIGEST_BYTES_MAX, "{longest}");
    let read = messages
        .iter()
        .map(|message| Digest::read(message).unwrap());
    let read: Vec<_> = read.flat_map(|digest| digest.reports).collect();
    assert_eq!(read, reports);
    assert!(Digest::messages(&[]).unwrap().is_empty());
    // As an instance reads it that knows of no heartbeats.
    let heartbeat = Digest::read(Digest::HEARTBEAT).unwrap();
    assert_eq!(heartbeat.reports, []);
}
