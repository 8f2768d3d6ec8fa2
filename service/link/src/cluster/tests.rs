//! Instances of a cluster and a robot, over a real router.

mod frozen;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use fleetcal_clock::{Clock, MockClock};
use fleetcal_cluster::{
    ClaimId, Epoch, HEARTBEATS_MISSING_AFTER, Incarnation, InstanceId, LinkReport, Membership,
    Seat, Tenure,
};
use fleetcal_contract::TestDatabase;
use fleetcal_domain::approval::Policy;
use fleetcal_domain::limits;
use fleetcal_domain::robot::{RobotConfig, Wheelbase};
use fleetcal_domain::streams::Ros2Settings;
use fleetcal_estimator::EstimatorSettings;
use fleetcal_fleet::{Digest, FleetHandle, FleetSetup, Keep};
use fleetcal_model::VehicleModel;
use fleetcal_operations::lifecycle::{Lifecycle, LifecycleSetup};
use fleetcal_patience::{PATIENCE, until_answered};
use fleetcal_ports::free_address;
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::{EstimateDocument, EstimatedBy};
use fleetcal_proto::key::{Keys, StreamKind};
use fleetcal_proto::message_type::MessageType;
use fleetcal_proto::ros::{AckermannDrive, AckermannDriveStamped, Header, RosMessage, Time};
use fleetcal_proto::signing::SigningKey;
use fleetcal_store::Store;
use tokio::sync::watch;
use zenoh::Session;
use zenoh::bytes::Encoding;

use crate::{Link, LinkSetup};

/// Message time at which the tests begin, ns since 1970.
const BEGIN_NS: i64 = 1_700_000_000_000_000_000;
const ROBOTS: [&str; 2] = ["tugger_01", "tugger_02"];

fn id(name: &str) -> RobotId {
    RobotId::parse(name).unwrap()
}

fn free_endpoint() -> String {
    format!("tcp/{}", free_address())
}

async fn session(mode: &str, key: &str, endpoint: &str) -> Session {
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("mode", format!("\"{mode}\"")),
        ("listen/endpoints", "[]".to_owned()),
        (key, format!("[\"{endpoint}\"]")),
        ("scouting/multicast/enabled", "false".to_owned()),
        ("scouting/gossip/enabled", "false".to_owned()),
    ] {
        config.insert_json5(key, &value).unwrap();
    }
    zenoh::open(config).await.unwrap()
}

/// An instance whose place in the cluster the test sets.
struct Instance {
    membership: Membership,
    clock: Arc<MockClock>,
    fleet: FleetHandle,
    lifecycle: Lifecycle,
    store: Store,
    link: Link,
    report: watch::Receiver<LinkReport>,
    _database: TestDatabase,
}

impl Instance {
    async fn join(name: &str, router: &str) -> Self {
        let open = async |setup, fleet, lifecycle, clock: Arc<MockClock>| {
            Link::open(setup, fleet, lifecycle, clock).await.unwrap()
        };
        Self::linked_by(name, router, open).await
    }

    /// Makes an instance whose link `open` opens.
    async fn linked_by(
        name: &str,
        router: &str,
        open: impl AsyncFnOnce(LinkSetup, FleetHandle, Lifecycle, Arc<MockClock>) -> Link,
    ) -> Self {
        let name = InstanceId::parse(name).unwrap();
        let membership = Membership::of(name);
        let clock = MockClock::at(BEGIN_NS);
        let database = TestDatabase::new().await;
        let store = database.open(clock.clone()).await;
        let wheelbase = Wheelbase::try_from(1.2).unwrap();
        let vehicle = RobotConfig::of_vehicle(VehicleModel::Bicycle, wheelbase);
        let fleet = FleetHandle::start(FleetSetup {
            clock: clock.clone(),
            journal: Arc::new(store.clone()),
            estimator: EstimatorSettings::default(),
            robots: ROBOTS.map(|name| (id(name), vehicle.clone())).into(),
            cross_tracks: BTreeMap::new(),
            checkpoints: BTreeMap::new(),
            last_heard: BTreeMap::new(),
            audited: fleetcal_model::AuditId(0),
            membership: membership.clone(),
        });
        let lifecycle = Lifecycle::start(LifecycleSetup {
            store: store.clone(),
            fleet: fleet.clone(),
            clock: clock.clone(),
            policy: Policy::default(),
            keys: SigningKey::from_bytes(&[7; 32]).into(),
            membership: membership.clone(),
        });
        let lifecycle = lifecycle.await.unwrap();
        let (sender, report) = watch::channel(LinkReport::default());
        let setup = LinkSetup {
            connect: vec![router.to_owned()],
            ros2: Ros2Settings::default(),
            membership: membership.clone(),
            report: sender,
            ..LinkSetup::default()
        };
        let link = open(setup, fleet.clone(), lifecycle.clone(), clock.clone()).await;
        let instance = Self {
            membership,
            clock,
            fleet,
            lifecycle,
            store,
            link,
            report,
            _database: database,
        };
        instance.renew();
        instance
    }

    /// Renews the lease, as if the database answered at this moment.
    fn renew(&self) {
        self.pass(Duration::ZERO);
    }

    /// Advances the clock while the lease is renewed.
    fn pass(&self, time: Duration) {
        let cluster = self.membership.cluster().unwrap();
        cluster.lease().renewed(self.clock.uptime() + time);
        cluster.answered(self.clock.uptime() + time);
        self.clock.advance(time);
    }

    fn name(&self) -> InstanceId {
        self.membership.cluster().unwrap().instance().clone()
    }

    async fn adopt(&self, robot: &str, epoch: i64) {
        self.membership.cluster().unwrap().began(Tenure {
            robot: id(robot),
            seat: Seat {
                instance: self.name(),
                incarnation: Incarnation(1),
            },
            epoch: Epoch(epoch),
            claim: ClaimId(epoch),
        });
        self.fleet.adopt(&id(robot), None);
        let robot = id(robot);
        let subscribed = tokio::time::timeout(PATIENCE, self.fleet.subscribed(&robot));
        subscribed.await.unwrap();
        // Routers and robots hear of it a little later: both instances hear a robot for so long.
        tokio::time::sleep(limits::CLUSTER_OVERLAP).await;
    }

    async fn leave(self) {
        self.link.close().await;
        self.lifecycle.stop().await;
        self.fleet.stop().await;
        self.store.close().await.unwrap();
    }

    fn processed(&self, robot: &str) -> u64 {
        self.fleet.robot(&id(robot)).unwrap().counters.processed
    }
}

/// Robots, whose messages of a second are sent at once, and the estimates published for them.
struct Robots {
    session: Session,
    sent: Mutex<i64>,
    estimates: Arc<Mutex<Vec<EstimateDocument>>>,
}

impl Robots {
    async fn connect(router: &str) -> Self {
        let session = session("client", "connect/endpoints", router).await;
        let estimates: Arc<Mutex<Vec<EstimateDocument>>> = Arc::default();
        let heard = Arc::clone(&estimates);
        let key = Keys::default().stream_of_all(StreamKind::Estimate);
        let subscriber = session.declare_subscriber(key).callback(move |sample| {
            let document = serde_json::from_slice(&sample.payload().to_bytes()).unwrap();
            heard.lock().unwrap().push(document);
        });
        subscriber.background().await.unwrap();
        Self {
            session,
            sent: Mutex::new(0),
            estimates,
        }
    }

    /// Sends two seconds of wheel odometry of every robot.
    async fn drive(&self) {
        let keys = Keys::default();
        let key = |robot| keys.stream(&id(robot), StreamKind::WheelOdometry);
        self.drive_on(&ROBOTS.map(key)).await;
    }

    /// Sends the same on these keys.
    async fn drive_on(&self, keys: &[String]) {
        let from = std::mem::replace(&mut *self.sent.lock().unwrap(), 0);
        for number in from..from + 100 {
            let stamp = Time::from_ns(BEGIN_NS + number * 20_000_000).unwrap();
            let payload = AckermannDriveStamped {
                header: Header {
                    stamp,
                    frame_id: String::new(),
                },
                drive: AckermannDrive {
                    speed: 1.0,
                    ..AckermannDrive::default()
                },
            }
            .to_cdr();
            for key in keys {
                let put = self.session.put(key, payload.clone());
                put.encoding(Encoding::APPLICATION_CDR).await.unwrap();
            }
        }
        *self.sent.lock().unwrap() = from + 100;
    }

    /// Returns the instances that have published estimates of a robot since the last call.
    fn estimated_by(&self, robot: &str) -> Vec<Option<EstimatedBy>> {
        let mut estimates = self.estimates.lock().unwrap();
        let of_robot = |document: &EstimateDocument| document.robot == id(robot);
        let by = estimates.iter().filter(|document| of_robot(document));
        let by = by.map(|document| document.estimated_by.clone()).collect();
        estimates.retain(|document| !of_robot(document));
        by
    }

    /// Returns the number of answers to a query.
    async fn answers(&self, kind: StreamKind, robot: &str) -> usize {
        let key = Keys::default().stream(&id(robot), kind);
        let asked = self.session.get(key).target(zenoh::query::QueryTarget::All);
        let asked = asked.consolidation(zenoh::query::ConsolidationMode::None);
        let replies = asked.timeout(Duration::from_secs(2)).await.unwrap();
        let mut count = 0;
        while let Ok(reply) = replies.recv_async().await {
            count += usize::from(reply.result().is_ok());
        }
        count
    }
}

fn by(instance: &str, epoch: i64) -> EstimatedBy {
    EstimatedBy {
        instance: instance.to_owned(),
        epoch,
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn each_instance_hears_its_robots_and_tells_the_others_of_them() {
    let endpoint = free_endpoint();
    let router = session("router", "listen/endpoints", &endpoint).await;
    let [a, b] = [
        Instance::join("a", &endpoint).await,
        Instance::join("b", &endpoint).await,
    ];
    let robots = Robots::connect(&endpoint).await;
    for (instance, other) in [(&a, &b), (&b, &a)] {
        until_answered("the other one is seen", async || {
            let report = instance.report.borrow();
            report.linked && report.present.contains(&other.name())
        })
        .await;
    }
    a.adopt("tugger_01", 3).await;
    b.adopt("tugger_02", 4).await;
    robots.drive().await;
    until_answered("both have theirs", async || {
        a.processed("tugger_01") == 100 && b.processed("tugger_02") == 100
    })
    .await;
    for instance in [&a, &b] {
        instance.pass(limits::REPORT_WHOLE_EVERY);
    }
    until_answered("both are told of the other's", async || {
        let told = |one: &Instance, robot| {
            let view = one.fleet.robot(&id(robot)).unwrap();
            view.counters.processed == 100 && view.estimate.is_some()
        };
        told(&a, "tugger_02") && told(&b, "tugger_01")
    })
    .await;
    let mirrored = b.fleet.robot(&id("tugger_01")).unwrap();
    assert_eq!(mirrored.estimated_by, Some(by("a", 3)));
    until_answered("estimates are put", async || {
        !robots.estimates.lock().unwrap().is_empty()
    })
    .await;
    tokio::time::sleep(Duration::from_millis(1_500)).await;
    let (first, second) = (
        robots.estimated_by("tugger_01"),
        robots.estimated_by("tugger_02"),
    );
    assert!(
        !first.is_empty() && first.iter().all(|one| *one == Some(by("a", 3))),
        "{first:?}"
    );
    assert!(
        !second.is_empty() && second.iter().all(|one| *one == Some(by("b", 4))),
        "{second:?}"
    );
    assert_eq!(robots.answers(StreamKind::Progress, "tugger_01").await, 1);
    // One is moved.
    a.fleet.release(&id("tugger_01"), Keep::State).await;
    a.membership.cluster().unwrap().ended(&id("tugger_01"));
    b.adopt("tugger_01", 4).await;
    robots.drive().await;
    until_answered("the other one has it", async || {
        b.processed("tugger_01") == 100
    })
    .await;
    assert_eq!(a.fleet.heard(), Some(BTreeSet::new()));
    assert_eq!(b.fleet.heard().unwrap().len(), 2);
    b.leave().await;
    until_answered("the other one is gone", async || {
        let name = InstanceId::parse("b").unwrap();
        !a.report.borrow().present.contains(&name)
    })
    .await;
    a.leave().await;
    drop(router);
}

/// Kills an instance whose token Zenoh, over QUIC, keeps for the rest of its `lease`.
#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn an_instance_without_heartbeats_is_silent_while_its_token_stands() {
    let endpoint = free_endpoint();
    let router = session("router", "listen/endpoints", &endpoint).await;
    let a = Instance::join("a", &endpoint).await;
    let b = Instance::join("b", &endpoint).await;
    // The clocks of the tests stand: heartbeats that have come are missing when they go on.
    let has_fresh_heartbeat = |at: &Instance, name: &InstanceId| {
        let (report, now) = (at.report.borrow(), at.clock.uptime());
        !report.is_silent(name, now) && report.is_silent(name, now + HEARTBEATS_MISSING_AFTER)
    };
    until_answered("heartbeats come", async || {
        has_fresh_heartbeat(&a, &b.name()) && has_fresh_heartbeat(&b, &a.name())
    })
    .await;
    let (keys, silent) = (Keys::default(), InstanceId::parse("c").unwrap());
    let token = router.liveliness().declare_token(keys.service(&silent));
    let _token = token.await.unwrap();
    until_answered("its heartbeat came", async || {
        let heartbeat = router.put(keys.digest(&silent), Digest::HEARTBEAT);
        heartbeat.await.unwrap();
        has_fresh_heartbeat(&a, &silent)
    })
    .await;
    // The last of them may still be under way.
    until_answered("its heartbeats are missing", async || {
        a.pass(HEARTBEATS_MISSING_AFTER);
        until_answered("the others' go on", async || {
            has_fresh_heartbeat(&a, &b.name())
        })
        .await;
        let report = a.report.borrow();
        assert!(report.present.contains(&silent));
        report.is_silent(&silent, a.clock.uptime())
    })
    .await;
    a.leave().await;
    b.leave().await;
    drop(router);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn a_robot_on_ros_2_is_heard_by_the_instance_that_has_it() {
    let endpoint = free_endpoint();
    let router = session("router", "listen/endpoints", &endpoint).await;
    let a = Instance::join("a", &endpoint).await;
    let b = Instance::join("b", &endpoint).await;
    a.adopt("tugger_01", 1).await;
    let robots = Robots::connect(&endpoint).await;
    let topic = format!(
        "{}/RIHS01_64c1",
        MessageType::AckermannDriveStamped.dds_type()
    );
    let token =
        format!("@ros2_lv/0/aa/1/11/MP/%/%/node/%tugger_01%wheel_odometry/{topic}/::,10:,:,:,,");
    let _token = robots
        .session
        .liveliness()
        .declare_token(token)
        .await
        .unwrap();
    let announced = async |one: &Instance| {
        let view = one.fleet.robot(&id("tugger_01")).unwrap();
        !view.topics.is_empty()
    };
    until_answered("its topic is known", async || {
        announced(&a).await && announced(&b).await
    })
    .await;
    tokio::time::sleep(limits::CLUSTER_OVERLAP).await;
    let key = format!("0/tugger_01/wheel_odometry/{topic}");
    robots.drive_on(std::slice::from_ref(&key)).await;
    until_answered("its owner hears it", async || {
        a.processed("tugger_01") == 100
    })
    .await;
    assert_eq!(b.processed("tugger_01"), 0);
    // It is moved: the next owner has known the token all the time.
    a.fleet.release(&id("tugger_01"), Keep::State).await;
    a.membership.cluster().unwrap().ended(&id("tugger_01"));
    b.adopt("tugger_01", 2).await;
    robots.drive_on(&[key]).await;
    until_answered("the other one hears it", async || {
        b.processed("tugger_01") == 100
    })
    .await;
    a.leave().await;
    b.leave().await;
    drop(router);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn nothing_leaves_after_the_lease_has_ended() {
    let endpoint = free_endpoint();
    let router = session("router", "listen/endpoints", &endpoint).await;
    let a = Instance::join("a", &endpoint).await;
    let b = Instance::join("b", &endpoint).await;
    let robots = Robots::connect(&endpoint).await;
    a.adopt("tugger_01", 1).await;
    robots.drive().await;
    let put = async || !robots.estimated_by("tugger_01").is_empty();
    until_answered("an estimate is put", put).await;
    until_answered("the other one is told", async || {
        b.fleet.robot(&id("tugger_01")).unwrap().estimate.is_some()
    })
    .await;
    // The process is held up until its lease is over, and goes on as if nothing had been.
    a.clock.advance(limits::CLUSTER_LEASE);
    tokio::time::sleep(Duration::from_millis(1_200)).await;
    robots.estimated_by("tugger_01");
    let told = b.fleet.robot(&id("tugger_01")).unwrap().estimate;
    robots.drive().await;
    until_answered("its estimator goes on", async || {
        a.processed("tugger_01") == 200
    })
    .await;
    tokio::time::sleep(Duration::from_millis(2_500)).await;
    assert_eq!(robots.estimated_by("tugger_01"), []);
    assert_eq!(b.fleet.robot(&id("tugger_01")).unwrap().estimate, told);
    a.renew();
    until_answered("it acts again", put).await;
    a.leave().await;
    b.leave().await;
    drop(router);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn who_does_not_reach_the_database_leaves_robots_to_others() {
    let endpoint = free_endpoint();
    let router = session("router", "listen/endpoints", &endpoint).await;
    let a = Instance::join("a", &endpoint).await;
    let key = Keys::default().stream(&id("tugger_01"), StreamKind::CalibrationApproved);
    let querier = router.declare_querier(key).await.unwrap();
    let is_answered = async || querier.matching_status().await.unwrap().matching();
    until_answered("it answers", is_answered).await;
    a.clock.advance(limits::CLUSTER_UNANSWERED_AFTER);
    until_answered("it leaves them", async || !is_answered().await).await;
    a.renew();
    until_answered("it answers again", is_answered).await;
    a.leave().await;
    drop(router);
}
