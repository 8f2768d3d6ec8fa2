//! The robots of the fleet, and what all of its tasks share.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, PoisonError, RwLock};
use std::time::Duration;

use fleetcal_clock::SharedClock;
use fleetcal_cluster::Membership;
use fleetcal_domain::limits;
use fleetcal_domain::robot::{HistoryEvent, Journal, RobotConfig};
use fleetcal_estimator::{Calibrator, Effect, EstimatorSettings, Event};
use fleetcal_model::{AuditId, RobotId, Stream};
use prometheus_client::metrics::histogram::Histogram;
use serde::Serialize;
use tokio::sync::{broadcast, watch as watch_channel};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::descriptions::Descriptions;
use crate::left_out::LeftOutReason;
use crate::live::LiveUpdate;
use crate::mailbox::Message;
use crate::peers::PeerSessions;
use crate::preview::Previews;
use crate::robot::Robot;

/// Upper bounds of the histogram's buckets for a scan, s: a scan takes about a millisecond, and the
/// next one comes after 0.1 s.
const SCAN_BUCKETS_S: [f64; 10] = [
    0.0005, 0.001, 0.002, 0.004, 0.008, 0.016, 0.032, 0.064, 0.1, 0.5,
];

/// Makes an empty histogram of durations for a scan.
pub(super) fn scan_durations() -> Histogram {
    Histogram::new(SCAN_BUCKETS_S)
}

/// Time without data after which an unregistered robot makes room for another.
const UNREGISTERED_KEPT: Duration = Duration::from_mins(1);

/// Counters of the whole service, for `/metrics`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct FleetCounters {
    /// Messages received on any key.
    pub received: u64,
    /// Messages on keys of no known robot or stream.
    pub foreign_keys: u64,
    /// Messages larger than [`fleetcal_domain::limits::payload_bytes_max`].
    pub oversized: u64,
    /// Messages of robots beyond [`fleetcal_domain::limits::UNREGISTERED_ROBOTS_MAX`].
    pub beyond_robots_max: u64,
    /// Queries over Zenoh beyond [`fleetcal_domain::limits::QUESTIONS_MAX`].
    pub unanswered_questions: u64,
    /// Notes of robots beyond their hourly budget.
    pub notes_beyond_budget: u64,
    /// Events of estimators beyond their robot's hourly budget.
    pub events_beyond_budget: u64,
    /// Messages that, by the stamps of their neighbours, were sent and never reached the estimator:
    /// lost on the way, or dropped.
    pub missing: u64,
    /// Messages that were dropped because two senders use their robot's id.
    pub of_two_senders: u64,
    /// Messages that an estimator left out, by reason.
    pub left_out: Vec<(&'static str, u64)>,
    /// Estimators that panicked.
    pub estimator_panics: u64,
    /// Messages received from robots in each stream.
    pub by_stream: BTreeMap<&'static str, u64>,
}

#[derive(Debug, Default)]
pub(crate) struct Counts {
    pub(super) received: AtomicU64,
    pub(super) foreign_keys: AtomicU64,
    pub(super) oversized: AtomicU64,
    pub(super) beyond_robots_max: AtomicU64,
    pub(super) unanswered_questions: AtomicU64,
    pub(crate) notes_beyond_budget: AtomicU64,
    pub(crate) events_beyond_budget: AtomicU64,
    pub(crate) missing: AtomicU64,
    pub(crate) of_two_senders: AtomicU64,
    pub(crate) left_out: [AtomicU64; LeftOutReason::COUNT],
    pub(super) estimator_panics: AtomicU64,
    pub(super) by_stream: [AtomicU64; Stream::COUNT],
}

/// Function by which an estimator processes an event.
pub(crate) type Step = fn(&mut Calibrator, Event) -> Vec<Effect>;

/// State that all tasks of the fleet share.
#[derive(Debug)]
pub(crate) struct Fleet {
    pub(crate) clock: SharedClock,
    pub(crate) journal: Arc<dyn Journal>,
    pub(crate) estimator: EstimatorSettings,
    pub(crate) stop: CancellationToken,
    /// [`Calibrator::step`], or a test's replacement.
    pub(crate) step: Step,
    pub(super) robots: RwLock<BTreeMap<RobotId, Arc<Robot>>>,
    pub(super) live: broadcast::Sender<LiveUpdate>,
    pub(crate) counts: Counts,
    /// Descriptions that robots publish of themselves.
    pub(super) descriptions: Descriptions,
    /// Previews of unregistered robots.
    pub(crate) previews: Previews,
    /// The Zenoh sessions of all robots and others.
    pub(super) peers: PeerSessions,
    /// Durations of the estimators for a scan.
    pub(super) scan_durations: Histogram,
    /// Times from a scan's arrival until it is processed.
    pub(super) scan_latencies: Histogram,
    pub(super) tasks: TaskTracker,
    /// Memory for the latest data of all robots, bytes.
    pub(crate) latest_data_bytes_max: AtomicUsize,
    /// Counter of changes of robots' configurations, and of those that are previewed.
    pub(super) configured: watch_channel::Sender<u64>,
    /// Membership: this process estimates all robots, or those that it adopts.
    pub(crate) membership: Membership,
    /// Newest row of the audit when this process began: earlier notes do not concern a robot
    /// without a stored state.
    pub(crate) audited: AuditId,
    /// Counter of changes of the robots whose messages are wanted.
    pub(super) heard: watch_channel::Sender<u64>,
    /// Robots that the link is subscribed to.
    pub(super) subscribed: watch_channel::Sender<BTreeSet<RobotId>>,
}

/// Makes a robot that has sent nothing yet. An instance of a cluster estimates none until it adopts
/// it.
pub(super) fn new_robot(
    membership: &Membership,
    id: &RobotId,
    config: Option<RobotConfig>,
) -> Arc<Robot> {
    let robot = Robot::new(id.clone(), config);
    if membership.cluster().is_some() {
        robot.mailbox.close();
    }
    Arc::new(robot)
}

impl Fleet {
    /// Publishes an update to every listener; having none is no error.
    pub(crate) fn announce(&self, update: LiveUpdate) {
        drop(self.live.send(update));
    }

    /// Records an entry in a robot's history and publishes it to every listener.
    pub(crate) fn record(&self, robot: &RobotId, event: HistoryEvent) {
        let event = Arc::new(event);
        self.journal.record_event(robot, &event);
        self.announce(LiveUpdate::Event {
            robot: robot.clone(),
            event,
            author: None,
        });
    }

    /// Returns the counters of the whole service.
    pub(super) fn counters(&self) -> FleetCounters {
        let counts = &self.counts;
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        let streams = Stream::ALL.iter().zip(&counts.by_stream);
        FleetCounters {
            received: read(&counts.received),
            foreign_keys: read(&counts.foreign_keys),
            oversized: read(&counts.oversized),
            beyond_robots_max: read(&counts.beyond_robots_max),
            unanswered_questions: read(&counts.unanswered_questions),
            notes_beyond_budget: read(&counts.notes_beyond_budget),
            events_beyond_budget: read(&counts.events_beyond_budget),
            missing: read(&counts.missing),
            of_two_senders: read(&counts.of_two_senders),
            left_out: LeftOutReason::ALL
                .iter()
                .zip(&counts.left_out)
                .map(|(reason, count)| (reason.name(), read(count)))
                .collect(),
            estimator_panics: read(&counts.estimator_panics),
            by_stream: streams
                .map(|(stream, count)| (stream.name(), read(count)))
                .collect(),
        }
    }

    /// Records that an estimator has finished a message that it began at running time `began`; only
    /// scans take long enough to be measured.
    pub(crate) fn took(&self, message: &Message, began: Duration) {
        if message.stream == Stream::Scan {
            let took = self.clock.elapsed().saturating_sub(began);
            self.scan_durations.observe(took.as_secs_f64());
            let since_ns = self.clock.now().ns_since(message.arrived_ns);
            self.scan_latencies.observe(since_ns as f64 * 1e-9);
        }
    }

    /// Signals a change of the robots' configurations, or of those that are previewed.
    pub(crate) fn configuration_changed(&self) {
        self.configured.send_modify(|changes| *changes += 1);
    }

    /// Drops the preview of a robot.
    pub(crate) fn end_preview(&self, robot: &RobotId) {
        if self.previews.end(robot) {
            self.configuration_changed();
        }
    }

    /// Counts an estimator's panic.
    pub(crate) fn count_panic(&self) {
        self.counts.estimator_panics.fetch_add(1, Ordering::Relaxed);
    }

    // The map is whole after every statement, so the panic of another thread is no reason to stop.
    pub(super) fn find(&self, id: &str) -> Option<Arc<Robot>> {
        self.robots
            .read()
            .unwrap_or_else(PoisonError::into_inner)
            .get(id)
            .cloned()
    }

    pub(crate) fn all(&self) -> Vec<Arc<Robot>> {
        let robots = self.robots.read().unwrap_or_else(PoisonError::into_inner);
        robots.values().cloned().collect()
    }

    /// Finds the robot of this id; a new one is admitted as unregistered, if there is room.
    pub(super) fn find_or_admit(&self, id: &RobotId) -> Option<Arc<Robot>> {
        if let Some(robot) = self.find(id.as_str()) {
            return Some(robot);
        }
        let mut robots = self.robots.write().unwrap_or_else(PoisonError::into_inner);
        let unregistered = || robots.values().filter(|robot| !robot.is_configured());
        if unregistered().count() >= limits::UNREGISTERED_ROBOTS_MAX {
            // One that has never sent a sample, but described or announced itself, goes first.
            let quiet = |robot: &Robot| robot.quiet_for(&*self.clock).unwrap_or(Duration::MAX);
            let longest = unregistered().max_by_key(|robot| quiet(robot))?;
            if quiet(longest) < UNREGISTERED_KEPT {
                return None;
            }
            let gone = longest.id.clone();
            robots.remove(&gone);
            self.descriptions.forget(&gone);
        }
        let robot = new_robot(&self.membership, id, None);
        Some(Arc::clone(robots.entry(id.clone()).or_insert(robot)))
    }

    /// Finds the robot of this id, or adds one that is registered by the cluster's rows; its
    /// configuration may come later.
    pub(super) fn find_or_add(&self, id: &RobotId) -> Arc<Robot> {
        let mut robots = self.robots.write().unwrap_or_else(PoisonError::into_inner);
        let robot = || new_robot(&self.membership, id, None);
        Arc::clone(robots.entry(id.clone()).or_insert_with(robot))
    }

    /// Stores a robot's cross-track errors.
    pub(crate) fn save_cross_tracks(&self, robot: &Robot) {
        for (generation, errors) in robot.unsaved_cross_tracks() {
            self.journal
                .save_cross_track(&robot.id, generation, &errors);
        }
    }
}
