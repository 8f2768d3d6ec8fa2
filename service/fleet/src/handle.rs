//! The fleet as the API, the link and the commands hold it.

mod cluster;
mod descriptions;
mod previews;
mod recorded;
mod refused;
mod retired;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, PoisonError, RwLock};
use std::time::Duration;

use fleetcal_clock::SharedClock;
use fleetcal_cluster::Membership;
use fleetcal_domain::approval::Policy;
use fleetcal_domain::limits;
use fleetcal_domain::robot::{
    AnnouncedTopic, CrossTrack, Journal, RobotConfig, RobotState, RobotView,
};
use fleetcal_domain::streams::RobotStreams;
use fleetcal_estimator::advice::ranking::Ranked;
use fleetcal_estimator::calibrator::TopView;
use fleetcal_estimator::{Calibrator, EstimatorSettings, Pose2};
use fleetcal_model::{AuditId, Generation, RobotTime, Stream, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::encoding::Encoding;
use fleetcal_proto::estimate::EstimateDocument;
use fleetcal_proto::message_type::Form;
use fleetcal_proto::progress::Progress;
use prometheus_client::metrics::histogram::Histogram;
use tokio::sync::{broadcast, watch as watch_channel};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::cross_track::{self, UsedValues};
use crate::descriptions::Descriptions;
use crate::live::LiveUpdate;
use crate::mailbox::Message;
use crate::notes::Noted;
use crate::peers::PeerSessions;
use crate::preview::Previews;
use crate::registry::{Counts, Fleet, FleetCounters, Step, new_robot, scan_durations};
use crate::robot::{Configured, Robot};
use crate::senders::Origin;
use crate::watch;
pub use refused::FleetRefused;

/// Form and origin of a message on arrival.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Arrived {
    /// Encoding and type of the message.
    pub form: Form,
    /// Origin, where that is known.
    pub origin: Option<Origin>,
}

impl<F: Into<Form>> From<F> for Arrived {
    fn from(form: F) -> Self {
        Self {
            form: form.into(),
            origin: None,
        }
    }
}

/// Parts and stored state that a fleet starts with.
#[derive(Debug)]
pub struct FleetSetup {
    /// Source of time.
    pub clock: SharedClock,
    /// Sink of the history.
    pub journal: Arc<dyn Journal>,
    /// Estimator settings of robots that have none of their own.
    pub estimator: EstimatorSettings,
    /// Configured robots.
    pub robots: BTreeMap<RobotId, RobotConfig>,
    /// Cross-track errors of the robots, by generation.
    pub cross_tracks: BTreeMap<RobotId, BTreeMap<Generation, CrossTrack>>,
    /// Checkpoints of the robots' tasks from before the service stopped, as
    /// [`Journal::save_checkpoint`] stored them.
    pub checkpoints: BTreeMap<RobotId, Vec<u8>>,
    /// Time of each robot's last message before this start, wall time, ns.
    pub last_heard: BTreeMap<RobotId, WallTime>,
    /// Membership: this process estimates all robots, or those that it adopts.
    pub membership: Membership,
    /// Newest row of the audit before any of the stored state was read.
    pub audited: AuditId,
}

/// Handle of the fleet, cheap to clone.
#[derive(Debug, Clone)]
pub struct FleetHandle {
    pub(crate) fleet: Arc<Fleet>,
}

impl FleetHandle {
    /// Starts the fleet: a task for each configured robot, on the runtime that this is called in.
    pub fn start(setup: FleetSetup) -> Self {
        Self::start_with(setup, Calibrator::step)
    }

    /// Starts the fleet with estimators that process events by `step`.
    pub(crate) fn start_with(setup: FleetSetup, step: Step) -> Self {
        let mut checkpoints = setup.checkpoints;
        let mut cross_tracks = setup.cross_tracks;
        let (live, _) = broadcast::channel(limits::LIVE_UPDATES_MAX);
        let robots = setup
            .robots
            .into_iter()
            .map(|(id, config)| {
                let robot = new_robot(&setup.membership, &id, Some(config));
                (id, robot)
            })
            .collect();
        let fleet = Arc::new(Fleet {
            clock: setup.clock,
            journal: setup.journal,
            estimator: setup.estimator,
            stop: CancellationToken::new(),
            step,
            robots: RwLock::new(robots),
            live,
            counts: Counts::default(),
            descriptions: Descriptions::default(),
            previews: Previews::default(),
            peers: PeerSessions::default(),
            scan_durations: scan_durations(),
            scan_latencies: scan_durations(),
            tasks: TaskTracker::new(),
            latest_data_bytes_max: AtomicUsize::new(limits::MOMENT_BYTES_MAX),
            configured: watch_channel::Sender::new(0),
            membership: setup.membership,
            audited: setup.audited,
            heard: watch_channel::Sender::new(0),
            subscribed: watch_channel::Sender::new(BTreeSet::new()),
        });
        let handle = Self { fleet };
        handle
            .fleet
            .tasks
            .spawn(watch::run(Arc::clone(&handle.fleet)));
        for robot in handle.fleet.all() {
            if let Some(stored) = cross_tracks.remove(&robot.id) {
                robot.restore_cross_tracks(stored);
            }
            if let Some(heard) = setup.last_heard.get(&robot.id) {
                robot.restore_last_heard(*heard);
            }
            let stored = checkpoints.remove(&robot.id);
            if handle.fleet.membership.cluster().is_none() {
                handle.spawn(&robot, stored);
            }
        }
        handle
    }

    /// Processes the waiting messages, stores the estimators' states, and ends every task. The link
    /// has to be closed before.
    pub async fn stop(&self) {
        self.fleet.stop.cancel();
        self.fleet.tasks.close();
        self.fleet.tasks.wait().await;
    }

    /// Returns every robot, by id.
    pub fn robots(&self) -> Vec<RobotView> {
        self.fleet
            .all()
            .iter()
            .map(|robot| robot.view(&*self.fleet.clock))
            .collect()
    }

    /// Returns one robot.
    pub fn robot(&self, id: &RobotId) -> Option<RobotView> {
        Some(self.fleet.find(id.as_str())?.view(&*self.fleet.clock))
    }

    /// Returns the settings of `[estimator]`.
    pub fn estimator(&self) -> &EstimatorSettings {
        &self.fleet.estimator
    }

    /// Configures a robot with its vehicle; it may be unknown, unregistered or configured already.
    /// Its estimate begins from nothing if the new configuration changes its basis. Storing the
    /// configuration is the caller's part. For a robot of another instance, the configuration is
    /// only remembered.
    ///
    /// # Errors
    /// [`limits::ROBOTS_MAX`] others are configured.
    pub fn configure(&self, id: &RobotId, config: RobotConfig) -> Result<Configured, FleetRefused> {
        let robot = {
            let mut robots = self
                .fleet
                .robots
                .write()
                .unwrap_or_else(PoisonError::into_inner);
            let configured = robots
                .values()
                .filter(|robot| robot.is_configured())
                .count();
            let known = robots.get(id).is_some_and(|robot| robot.is_configured());
            if !known && configured >= limits::ROBOTS_MAX {
                return Err(FleetRefused::RobotsMax);
            }
            let robot = || new_robot(&self.fleet.membership, id, None);
            Arc::clone(robots.entry(id.clone()).or_insert_with(robot))
        };
        let configured = robot.set_config(config, &self.fleet.estimator);
        if configured == Configured::First {
            self.begin_configured(&robot);
        } else {
            robot.mailbox.wake();
        }
        self.fleet.previews.end(id);
        self.fleet.configuration_changed();
        Ok(configured)
    }

    /// Checks that a note about a robot can reach its estimator; to be called before the note is
    /// stored. If another instance estimates the robot, or none at this moment, the note reaches
    /// its estimator later.
    ///
    /// # Errors
    /// The robot is unknown or unregistered, so that it has no estimator, its estimator is stopped,
    /// or too many notes wait.
    pub fn takes_notes(&self, id: &RobotId) -> Result<(), FleetRefused> {
        let unknown = || FleetRefused::UnknownRobot(id.clone());
        let robot = self.fleet.find(id.as_str()).ok_or_else(unknown)?;
        if !robot.is_configured() {
            return Err(FleetRefused::Unregistered(id.clone()));
        }
        if robot.is_retired() {
            return Err(FleetRefused::Retired(id.clone()));
        }
        if robot.state() == RobotState::Failed {
            return Err(FleetRefused::Stopped(id.clone()));
        }
        if robot.is_here() && !robot.mailbox.has_room_for_note() {
            return Err(FleetRefused::NotesMax(id.clone()));
        }
        Ok(())
    }

    /// Passes a stored note to a robot's estimator, which ignores a note that it has processed
    /// already.
    ///
    /// # Errors
    /// The robot is unknown, another instance estimates it, or too many notes wait: the note has to
    /// be passed again.
    pub fn note(&self, id: &RobotId, noted: Noted) -> Result<(), FleetRefused> {
        let unknown = || FleetRefused::UnknownRobot(id.clone());
        let robot = self.fleet.find(id.as_str()).ok_or_else(unknown)?;
        if !robot.is_here() {
            return Err(FleetRefused::Elsewhere(id.clone()));
        }
        if !robot.mailbox.push_note(noted) {
            robot.want_notes();
            return Err(FleetRefused::NotesMax(id.clone()));
        }
        Ok(())
    }

    /// Returns the number of the last note that the estimator of a robot estimated here has
    /// processed.
    pub fn notes_taken(&self, id: &RobotId) -> Option<AuditId> {
        let robot = self.fleet.find(id.as_str())?;
        robot.notes_taken().filter(|_| robot.is_here())
    }

    /// Requests again the notes that a robot's estimator has not received.
    pub fn want_notes(&self, id: &RobotId) {
        if let Some(robot) = self.fleet.find(id.as_str()) {
            robot.want_notes();
        }
    }

    /// True, once, if stored notes may be missing from a robot's estimator.
    pub fn wants_notes(&self, id: &RobotId) -> bool {
        let robot = self.fleet.find(id.as_str());
        robot.is_some_and(|robot| robot.is_here() && robot.wanted_notes())
    }

    /// Sets the values that a robot compensates with, oldest first, and the generation in
    /// verification with the start of its use by the agent's clock. Messages that wait in the
    /// robot's mailbox precede the change.
    pub fn use_values(
        &self,
        id: &RobotId,
        values: &[UsedValues],
        in_verification: Option<(Generation, RobotTime)>,
    ) {
        if let Some(robot) = self.fleet.find(id.as_str()) {
            robot.set_used(values, in_verification);
        }
    }

    /// True if the estimate of a calibrated robot has been stable for long enough to be proposed.
    /// The time for which it has been is stored with the robot's estimator. To be called each
    /// second.
    pub fn has_stable_estimate(&self, id: &RobotId, policy: &Policy) -> bool {
        let robot = self.fleet.find(id.as_str());
        robot.is_some_and(|robot| robot.observe_candidate(policy))
    }

    /// Publishes an update to every listener; having none is no error.
    pub fn announce(&self, update: LiveUpdate) {
        self.fleet.announce(update);
    }

    /// Receives a robot's cross-track error. It never blocks: this runs on the link's receiving
    /// threads. Unregistered robots are ignored.
    pub fn take_cross_track_error(&self, id: &RobotId, encoding: Encoding, payload: &[u8]) {
        let robot = self.fleet.find(id.as_str());
        let Some(robot) = robot.filter(|robot| robot.is_configured() && robot.is_here()) else {
            return;
        };
        match cross_track::read(encoding, payload) {
            Ok((stamp, error_m)) => {
                let received = self.fleet.clock.now();
                robot.take_cross_track_error(stamp, received, error_m);
            }
            Err(reason) => tracing::debug!(robot.id = %id, reason, "message refused"),
        }
    }

    /// Returns a robot's cross-track errors by the generation of the calibration in use; 0 covers
    /// its driving before any was applied.
    pub fn cross_tracks(&self, id: &RobotId) -> BTreeMap<Generation, CrossTrack> {
        let robot = self.fleet.find(id.as_str());
        robot.map(|robot| robot.cross_tracks()).unwrap_or_default()
    }

    /// Returns the manoeuvres that a robot should drive next, the best first; empty until it has
    /// sent something.
    pub fn manoeuvres(&self, id: &RobotId) -> Arc<[Ranked]> {
        let robot = self.fleet.find(id.as_str());
        robot.map_or_else(|| Arc::from([]), |robot| robot.manoeuvres())
    }

    /// Requests a robot's top view from its task, which draws it on request only; `None` while
    /// nothing is known.
    ///
    /// # Errors
    /// The robot is unknown, or too many requests wait.
    pub async fn top_view(&self, id: &RobotId) -> Result<Option<Arc<TopView>>, FleetRefused> {
        let unknown = || FleetRefused::UnknownRobot(id.clone());
        let robot = self.fleet.find(id.as_str()).ok_or_else(unknown)?;
        if !robot.is_configured() || !robot.is_here() {
            return Ok(None);
        }
        let busy = || FleetRefused::TopViewAskersMax(id.clone());
        let answer = robot.top_view_askers.ask().ok_or_else(busy)?;
        robot.mailbox.wake();
        tokio::select! {
            answer = answer => Ok(answer.ok().flatten()),
            () = self.fleet.stop.cancelled() => Ok(None),
        }
    }

    /// Subscribes to live updates from now on. A listener that lags by more than
    /// [`limits::LIVE_UPDATES_MAX`] receives the number that it lost.
    pub fn live(&self) -> broadcast::Receiver<LiveUpdate> {
        self.fleet.live.subscribe()
    }

    /// Returns the counters of the whole service.
    pub fn counters(&self) -> FleetCounters {
        self.fleet.counters()
    }

    /// Returns the counters of Zenoh sessions, as the link keeps them.
    pub fn peers(&self) -> &PeerSessions {
        &self.fleet.peers
    }

    /// True if a robot is sending.
    pub fn is_sending(&self, id: &RobotId) -> bool {
        let quiet = self.quiet_for(id);
        quiet.is_some_and(|quiet| quiet < limits::SENDING_WITHIN)
    }

    /// Returns the time since this process last received anything from a robot; `None` before the
    /// first message.
    pub fn quiet_for(&self, id: &RobotId) -> Option<Duration> {
        self.fleet.find(id.as_str())?.quiet_for(&*self.fleet.clock)
    }

    /// Returns the histogram of the estimators' durations for a scan, over all robots.
    pub fn scan_durations(&self) -> Histogram {
        self.fleet.scan_durations.clone()
    }

    /// Returns the histogram of the times from a scan's arrival until it is processed, over all
    /// robots.
    pub fn scan_latencies(&self) -> Histogram {
        self.fleet.scan_latencies.clone()
    }

    /// Returns the ids of all robots.
    pub fn ids(&self) -> Vec<RobotId> {
        self.fleet
            .all()
            .iter()
            .map(|robot| robot.id.clone())
            .collect()
    }

    /// Returns the latest estimate of every robot that has one.
    pub fn estimates(&self) -> BTreeMap<RobotId, Arc<EstimateDocument>> {
        let robots = self.fleet.all();
        robots
            .iter()
            .filter_map(|robot| Some((robot.id.clone(), robot.estimate()?)))
            .collect()
    }

    /// Returns the progress of a robot's task; `None` for an unknown robot.
    pub fn progress(&self, id: &RobotId) -> Option<Progress> {
        Some(self.fleet.find(id.as_str())?.mailbox.progress())
    }

    /// Receives a message. It never blocks: this runs on the link's receiving threads. `payload` is
    /// called only if the message is kept.
    pub fn receive(
        &self,
        id: &RobotId,
        stream: Stream,
        arrived: impl Into<Arrived>,
        bytes: usize,
        payload: impl FnOnce() -> Vec<u8>,
    ) {
        let Some(robot) = self.admit(id, stream) else {
            return;
        };
        let limit = limits::payload_bytes_max(stream);
        if robot.is_retired() {
            robot.mailbox.refuse(stream, "the robot is retired");
        } else if bytes > limit {
            self.fleet.counts.oversized.fetch_add(1, Ordering::Relaxed);
            let name = stream.name();
            let reason = format!("{name}: got {bytes} bytes, expected {limit} at most");
            robot.mailbox.refuse(stream, &reason);
        } else {
            let Arrived { form, origin } = arrived.into();
            let message = || Message {
                stream,
                form,
                origin,
                arrived_ns: self.fleet.clock.now(),
                payload: payload(),
            };
            if robot.is_configured() || robot.is_awaited() {
                robot.mailbox.push(message());
            } else {
                robot.mailbox.ignore(stream);
                self.fleet.previews.keep(id, stream, message);
            }
        }
    }

    /// Counts a message that the link itself refuses.
    pub fn refuse(&self, id: &RobotId, stream: Stream, reason: &str) {
        if let Some(robot) = self.admit(id, stream) {
            robot.mailbox.refuse(stream, reason);
        }
    }

    /// Counts a message on a former key of a stream, whose content is ignored: the robot gets a
    /// warning, and the refusal names the key to send to.
    pub fn refuse_former_key(&self, id: &RobotId, stream: Stream, key: &str) {
        if let Some(robot) = self.admit(id, stream) {
            robot.used_former_key(key, &*self.fleet.clock);
            let reason = format!("it was sent on a former key, expected is {key}");
            robot.mailbox.refuse(stream, &reason);
        }
    }

    /// Counts a message and finds its robot; `None` if there is no room for another robot, or
    /// another instance estimates it.
    fn admit(&self, id: &RobotId, stream: Stream) -> Option<Arc<Robot>> {
        if self.is_elsewhere(id) {
            return None;
        }
        let counts = &self.fleet.counts;
        counts.received.fetch_add(1, Ordering::Relaxed);
        if let Some(by_stream) = counts.by_stream.get(stream.index()) {
            by_stream.fetch_add(1, Ordering::Relaxed);
        }
        let robot = self.fleet.find_or_admit(id);
        match &robot {
            Some(robot) => robot.received(stream, &*self.fleet.clock),
            None => {
                counts.beyond_robots_max.fetch_add(1, Ordering::Relaxed);
            }
        }
        robot
    }

    /// Returns a channel that signals every change of a robot's configuration from now on.
    pub fn configured(&self) -> watch_channel::Receiver<u64> {
        self.fleet.configured.subscribe()
    }

    /// Returns the individually configured topics of every configured robot.
    pub fn streams(&self) -> BTreeMap<RobotId, RobotStreams> {
        let robots = self.fleet.all();
        robots
            .iter()
            .filter_map(|robot| Some((robot.id.clone(), robot.versioned_config()?.1.streams)))
            .collect()
    }

    /// Returns the pose of a robot's rear axle in its `base_link`, where that is configured.
    pub fn rear_axle_in_base_link(&self, id: &RobotId) -> Option<Pose2> {
        let (_, config) = self.fleet.find(id.as_str())?.versioned_config()?;
        let Pose2 { x_m, y_m, yaw_rad } = config.rear_axle_in_base_link?.pose();
        Some(Pose2 { x_m, y_m, yaw_rad })
    }

    /// Sets the ROS 2 topics that a robot has announced. An unknown robot becomes unregistered, if
    /// there is room, and counts as present as long as it announces any.
    pub fn set_topics(&self, id: &RobotId, topics: Vec<AnnouncedTopic>) {
        let robot = if topics.is_empty() {
            self.fleet.find(id.as_str())
        } else {
            self.fleet.find_or_admit(id)
        };
        if let Some(robot) = robot {
            robot.set_topics(topics, &*self.fleet.clock);
        }
    }

    /// Counts a message with a key of no known robot or stream.
    pub fn count_foreign_key(&self) {
        self.fleet.counts.received.fetch_add(1, Ordering::Relaxed);
        self.fleet
            .counts
            .foreign_keys
            .fetch_add(1, Ordering::Relaxed);
    }

    /// Counts a query that was dropped because too many others waited.
    pub fn count_unanswered_question(&self) {
        let counts = &self.fleet.counts;
        counts.unanswered_questions.fetch_add(1, Ordering::Relaxed);
    }

    /// Records that a robot's liveliness token appeared or disappeared.
    pub fn set_alive(&self, id: &RobotId, alive: bool) {
        let robot = if alive {
            self.fleet.find_or_admit(id)
        } else {
            self.fleet.find(id.as_str())
        };
        if let Some(robot) = robot {
            robot.set_alive(alive, &*self.fleet.clock);
        }
    }
}
