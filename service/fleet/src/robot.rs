//! One robot's place in the fleet: its mailbox, its connection, and what its task last said.

mod checks;
mod configured;
mod estimators;
mod innovations;
mod mirror;
mod notes;
mod retired;
mod used;

use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use fleetcal_clock::Clock;
use fleetcal_domain::approval::Policy;
use fleetcal_domain::limits::{SESSION_ENDS_AFTER, SESSION_ENDS_AFTER_TOKEN, STALE_AFTER};
use fleetcal_domain::robot::{
    AnnouncedTopic, ChecksReport, Connection, CrossTrack, PairingReport, RobotConfig, RobotState,
    RobotView, StreamView, Warning,
};
use fleetcal_estimator::advice::ranking::Ranked;
use fleetcal_estimator::{EstimatorSettings, RobotTime};
use fleetcal_model::{AuditId, Generation, Innovation, Stream, Version, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::CalibrationValues;
use fleetcal_proto::estimate::EstimateDocument;

use crate::candidate::Candidate;
use crate::cross_track::{CrossTracks, UsedValues};
use crate::mailbox::{Mailbox, Recipient};
use crate::tap::Taps;
use crate::tenancy::Tenancy;
use crate::top_view::TopViewAskers;
pub use configured::Configured;
use estimators::Estimators;
use innovations::Innovations;
use used::Used;

/// Window over which a stream's rate is averaged, s.
const RATE_WINDOW_S: usize = 5;

/// Receipts of one stream.
#[derive(Debug, Default)]
struct Receipts {
    messages: u64,
    last_received_ns: Option<WallTime>,
    /// Values of `messages` at the last ticks, one a second, oldest first.
    at_ticks: VecDeque<u64>,
}

impl Receipts {
    fn rate_hz(&self) -> f64 {
        let seconds = self.at_ticks.len().saturating_sub(1);
        match (self.at_ticks.front(), self.at_ticks.back()) {
            (Some(first), Some(last)) if seconds > 0 => (last - first) as f64 / seconds as f64,
            _ => 0.0,
        }
    }
}

/// Session of a robot, open or ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Session {
    /// Ended: nothing has come since.
    Ended,
    /// Messages come, or may still come.
    Open,
}

/// State of a robot's connection.
#[derive(Debug)]
struct Link {
    streams: [Receipts; Stream::COUNT],
    /// Time of its last message before the service started.
    heard_before_ns: Option<WallTime>,
    last_seen_ns: Option<WallTime>,
    last_seen: Option<Duration>,
    /// True if its own token is present.
    alive: bool,
    /// ROS 2 topics that it has announced.
    topics: Arc<[AnnouncedTopic]>,
    /// Running time at which the last token disappeared.
    token_gone: Option<Duration>,
    session: Session,
    /// Running time of its last message on a former key, and the key to send to.
    former_key: Option<(Duration, String)>,
    /// State, staleness and presence that listeners received last.
    announced: Option<(RobotState, bool, bool)>,
}

impl Link {
    fn is_alive(&self) -> bool {
        self.alive || !self.topics.is_empty()
    }
}

/// Latest state that the robot's task has published.
#[derive(Debug)]
struct Status {
    config: Option<RobotConfig>,
    /// Number that grows with every change of `config`.
    config_version: Version,
    state: RobotState,
    estimate: Option<Arc<EstimateDocument>>,
    estimator_restarts: u32,
    used: Used,
    verification: Option<(Generation, Arc<EstimateDocument>)>,
    /// Candidate for a proposal, with the time for which the estimate has been stable.
    candidate: Candidate,
    /// Manoeuvres that it should drive next, the best first.
    manoeuvres: Arc<[Ranked]>,
    pairing: Option<PairingReport>,
    warnings: Vec<Warning>,
    checks: Arc<ChecksReport>,
    /// True if a reported reassembly is open, also where there is no estimate yet.
    reassembly_open: bool,
    /// Number of the last note that its estimator has processed; `None` until its task sets it.
    notes_taken: Option<AuditId>,
}

/// One robot of the fleet.
#[derive(Debug)]
pub struct Robot {
    /// Its id.
    pub id: RobotId,
    /// Items that wait for its task.
    pub mailbox: Mailbox,
    /// Requests for its top view.
    pub top_view_askers: TopViewAskers,
    /// Readers that record it.
    pub taps: Taps,
    /// Its task, if it runs here.
    pub tenancy: Mutex<Tenancy>,
    link: Mutex<Link>,
    status: Mutex<Status>,
    cross_tracks: Mutex<CrossTracks>,
    innovations: Mutex<Innovations>,
    /// True if stored notes may be missing from its task.
    wants_notes: AtomicBool,
    /// True if it is retired: its messages are refused.
    retired: AtomicBool,
    /// Instance that estimates it, and the report of that instance.
    estimators: Mutex<Estimators>,
}

/// Locks a mutex. The values behind the locks are whole after every statement, so a panic of
/// another thread leaves nothing half done.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Robot {
    /// Makes a robot that has sent nothing yet.
    pub fn new(id: RobotId, config: Option<RobotConfig>) -> Self {
        let state = if config.is_some() {
            RobotState::NoData
        } else {
            RobotState::Unregistered
        };
        Self {
            id,
            mailbox: Mailbox::default(),
            top_view_askers: TopViewAskers::default(),
            taps: Taps::default(),
            link: Mutex::new(Link {
                streams: Default::default(),
                heard_before_ns: None,
                last_seen_ns: None,
                last_seen: None,
                alive: false,
                topics: Arc::from([]),
                token_gone: None,
                session: Session::Ended,
                former_key: None,
                announced: None,
            }),
            status: Mutex::new(Status {
                config,
                config_version: Version(0),
                state,
                estimate: None,
                estimator_restarts: 0,
                used: Used::default(),
                verification: None,
                candidate: Candidate::default(),
                manoeuvres: Arc::from([]),
                pairing: None,
                warnings: Vec::new(),
                checks: Arc::default(),
                reassembly_open: false,
                notes_taken: None,
            }),
            wants_notes: AtomicBool::new(false),
            retired: AtomicBool::new(false),
            cross_tracks: Mutex::default(),
            innovations: Mutex::default(),
            tenancy: Mutex::default(),
            estimators: Mutex::default(),
        }
    }

    /// Returns its latest innovations, oldest first.
    pub fn innovations(&self) -> Vec<Innovation> {
        lock(&self.innovations).latest()
    }

    /// Restores the time of its last message before the service started, wall time.
    pub fn restore_last_heard(&self, heard_ns: WallTime) {
        lock(&self.link).heard_before_ns = Some(heard_ns);
    }

    /// Records that a message came on `stream`.
    pub fn received(&self, stream: Stream, clock: &dyn Clock) {
        let now = clock.now();
        let mut link = lock(&self.link);
        link.last_seen_ns = Some(now);
        link.last_seen = Some(clock.elapsed());
        link.session = Session::Open;
        if let Some(receipts) = link.streams.get_mut(stream.index()) {
            receipts.messages += 1;
            receipts.last_received_ns = Some(now);
        }
    }

    /// Records that the robot sent on a former key of a stream whose key is `key`.
    pub fn used_former_key(&self, key: &str, clock: &dyn Clock) {
        let now = clock.elapsed();
        let mut link = lock(&self.link);
        match &mut link.former_key {
            Some((at, _)) => *at = now,
            None => link.former_key = Some((now, key.to_owned())),
        }
    }

    /// Records that the robot's liveliness token appeared or disappeared.
    pub fn set_alive(&self, alive: bool, clock: &dyn Clock) {
        let mut link = lock(&self.link);
        link.alive = alive;
        link.token_gone = (!link.is_alive()).then(|| clock.elapsed());
    }

    /// Sets the ROS 2 topics that it has announced: without any it is gone, as without a token.
    pub fn set_topics(&self, topics: Vec<AnnouncedTopic>, clock: &dyn Clock) {
        let mut link = lock(&self.link);
        let was_there = link.is_alive();
        link.topics = Arc::from(topics);
        if was_there != link.is_alive() {
            link.token_gone = was_there.then(|| clock.elapsed());
        }
    }

    /// Advances the rates; to be called once a second.
    pub fn tick(&self) {
        for receipts in &mut lock(&self.link).streams {
            receipts.at_ticks.push_back(receipts.messages);
            if receipts.at_ticks.len() > RATE_WINDOW_S + 1 {
                receipts.at_ticks.pop_front();
            }
        }
    }

    /// True, once, if the session has just ended: its token disappeared or nothing came for long,
    /// and all received messages are processed.
    pub fn session_just_ended(&self, clock: &dyn Clock) -> bool {
        let now = clock.elapsed();
        let mut link = lock(&self.link);
        let quiet = link
            .last_seen
            .map_or(Duration::MAX, |seen| now.saturating_sub(seen));
        let gone = link.token_gone.is_some_and(|gone| {
            now.saturating_sub(gone) >= SESSION_ENDS_AFTER_TOKEN
                && quiet >= SESSION_ENDS_AFTER_TOKEN
        });
        let over = gone || quiet >= SESSION_ENDS_AFTER;
        let is_here = self.mailbox.recipient() == Recipient::Task;
        let ends = link.session == Session::Open && over && is_here && self.mailbox.is_idle();
        if ends {
            link.session = Session::Ended;
        }
        ends
    }

    /// Returns the time since the last message; `None` before the first.
    pub fn quiet_for(&self, clock: &dyn Clock) -> Option<Duration> {
        lock(&self.link)
            .last_seen
            .map(|seen| clock.elapsed().saturating_sub(seen))
    }

    /// Returns state, staleness and presence if they differ from those announced last.
    pub fn to_announce(&self, clock: &dyn Clock) -> Option<(RobotState, bool, bool)> {
        let state = self.state();
        let stale = self.is_stale(clock);
        let mut link = lock(&self.link);
        let now = (state, stale, link.is_alive());
        if link.announced == Some(now) {
            return None;
        }
        link.announced = Some(now);
        Some(now)
    }

    fn is_stale(&self, clock: &dyn Clock) -> bool {
        if let Some(stale) = self.is_mirror_stale(clock) {
            return stale;
        }
        self.quiet_for(clock)
            .is_none_or(|quiet| quiet >= STALE_AFTER)
    }

    /// Returns the robot's state.
    pub fn state(&self) -> RobotState {
        lock(&self.status).state
    }

    /// True if it has a configuration.
    pub fn is_configured(&self) -> bool {
        lock(&self.status).config.is_some()
    }

    /// Returns the number that grows with every change of the configuration.
    pub fn config_version(&self) -> Version {
        lock(&self.status).config_version
    }

    /// Returns its configuration, and the number that grows with every change of it.
    pub fn versioned_config(&self) -> Option<(Version, RobotConfig)> {
        let status = lock(&self.status);
        Some((status.config_version, status.config.clone()?))
    }

    /// Returns the latest estimate.
    pub fn estimate(&self) -> Option<Arc<EstimateDocument>> {
        lock(&self.status).estimate.clone()
    }

    /// Sets the robot's configuration. An equal one changes nothing, and the estimate continues
    /// where its basis stays the same; `defaults` are the settings of `[estimator]`.
    pub fn set_config(&self, config: RobotConfig, defaults: &EstimatorSettings) -> Configured {
        let mut status = lock(&self.status);
        if status.config.as_ref() == Some(&config) {
            return Configured::GoesOn;
        }
        status.config_version = status.config_version.next();
        let Some(former) = status.config.replace(config) else {
            status.state = RobotState::NoData;
            return Configured::First;
        };
        let by_change = |config| Configured::by_change(&former, config, defaults);
        let configured = status.config.as_ref().map_or(Configured::GoesOn, by_change);
        if configured == Configured::GoesOn {
            return configured;
        }
        status.state = RobotState::NoData;
        status.estimate = None;
        status.candidate = Candidate::default();
        status.manoeuvres = Arc::from([]);
        status.pairing = None;
        status.warnings = Vec::new();
        status.checks = Arc::default();
        configured
    }

    /// Sets the robot's state.
    pub fn set_state(&self, state: RobotState) {
        lock(&self.status).state = state;
    }

    /// Restores, in one step, the state that its task had published before the service was
    /// restarted: readers see all of it or nothing.
    pub fn restore(
        &self,
        state: RobotState,
        estimate: Arc<EstimateDocument>,
        candidate: Candidate,
    ) {
        let mut status = lock(&self.status);
        status.state = state;
        status.estimate = Some(estimate);
        status.candidate = candidate;
        status.verification = None;
    }

    /// True if it is calibrated and its estimate has been stable for long enough by now.
    pub fn observe_candidate(&self, policy: &Policy) -> bool {
        let mut status = lock(&self.status);
        let is_calibrated = status.state == RobotState::Calibrated;
        let estimate = status.estimate.clone().filter(|_| is_calibrated);
        status.candidate.observe(estimate.as_deref(), policy)
    }

    /// Returns its candidate for a proposal.
    pub fn candidate(&self) -> Candidate {
        lock(&self.status).candidate.clone()
    }

    /// True if it is calibrated and no candidate for a proposal is pending.
    pub fn is_settled(&self) -> bool {
        let status = lock(&self.status);
        status.state == RobotState::Calibrated && !status.candidate.is_pending()
    }

    /// Sets a new estimate.
    pub fn set_estimate(&self, estimate: Arc<EstimateDocument>) {
        lock(&self.innovations).take_of(&estimate);
        lock(&self.status).estimate = Some(estimate);
    }

    /// Sets the quality of the pairing of its steering and speed.
    pub fn set_pairing(&self, report: PairingReport) {
        lock(&self.status).pairing = Some(report);
    }

    /// Sets the manoeuvres that the robot should drive next, the best first.
    pub fn set_manoeuvres(&self, ranked: Vec<Ranked>) {
        lock(&self.status).manoeuvres = Arc::from(ranked);
    }

    /// Returns the manoeuvres that the robot should drive next, the best first.
    pub fn manoeuvres(&self) -> Arc<[Ranked]> {
        Arc::clone(&lock(&self.status).manoeuvres)
    }

    /// Sets the values that the robot compensates with, oldest first, and the generation in
    /// verification with the start of its use by the agent's clock. Both apply to the messages that
    /// come after this.
    pub fn set_used(
        &self,
        values: &[UsedValues],
        in_verification: Option<(Generation, RobotTime)>,
    ) {
        {
            let mut status = lock(&self.status);
            let verification = status.verification.take();
            let generation = in_verification.map(|(generation, _)| generation);
            status.verification = verification.filter(|(of, _)| Some(*of) == generation);
            if !status.used.follow(values, in_verification) {
                return;
            }
            status.used.unheard = status.used.unheard.saturating_add(1);
        }
        if !self.mailbox.push_values_heard() {
            self.count_heard();
        }
    }

    fn count_heard(&self) {
        let mut status = lock(&self.status);
        status.used.unheard = status.used.unheard.saturating_sub(1);
    }

    /// Applies the robot's report from its place among the messages on, of which `newest` is the
    /// newest: the reported values apply from there on, whatever time the agent's clock shows.
    pub fn values_heard(&self, newest: RobotTime) {
        self.count_heard();
        let mut status = lock(&self.status);
        if let Some(latest) = status.used.values.last_mut() {
            latest.from_stamp = latest.from_stamp.min(newest);
        }
    }

    /// Handles a clock of its messages that went back: the values reported last apply to all that
    /// follow.
    pub fn clock_went_back(&self) {
        let mut status = lock(&self.status);
        if let Some(latest) = status.used.values.last_mut() {
            latest.from_stamp = RobotTime(i64::MIN);
        }
    }

    /// Returns the values that the robot compensated with at `stamp`; before its first report, the
    /// first reported ones.
    pub fn values_at(&self, stamp: RobotTime) -> Option<CalibrationValues> {
        self.used_at(stamp).map(|used| used.values)
    }

    fn used_at(&self, stamp: RobotTime) -> Option<UsedValues> {
        let status = lock(&self.status);
        let values = &status.used.values;
        let mut latest_first = values.iter().rev();
        let then = latest_first.find(|one| one.from_stamp <= stamp);
        then.or(values.first()).map(|one| one.used)
    }

    /// Adds a cross-track error, m; without a stamp it is dated now, `received`.
    pub fn take_cross_track_error(
        &self,
        stamp: Option<RobotTime>,
        received: WallTime,
        error_m: f64,
    ) {
        let used = self.used_at(stamp.unwrap_or(RobotTime(i64::MAX)));
        let generation = used.map_or(Generation::FACTORY, |used| used.generation);
        let at_ns = stamp.map_or(received.0, |stamp| stamp.0);
        lock(&self.cross_tracks).add(generation, at_ns, error_m);
    }

    /// Returns its cross-track errors, by generation.
    pub fn cross_tracks(&self) -> BTreeMap<Generation, CrossTrack> {
        lock(&self.cross_tracks).all().clone()
    }

    /// Returns the cross-track errors that have changed since the last call.
    pub fn unsaved_cross_tracks(&self) -> Vec<(Generation, CrossTrack)> {
        lock(&self.cross_tracks).take_unsaved()
    }

    /// Restores stored cross-track errors.
    pub fn restore_cross_tracks(&self, stored: BTreeMap<Generation, CrossTrack>) {
        *lock(&self.cross_tracks) = CrossTracks::of(stored);
    }

    /// Returns the generation in verification, and the start of its use by the agent's clock;
    /// `None` while messages wait that came before the robot's report.
    pub fn in_verification(&self) -> Option<(Generation, RobotTime)> {
        let status = lock(&self.status);
        status
            .used
            .in_verification
            .filter(|_| status.used.unheard == 0)
    }

    /// Sets an estimate of the generation in verification.
    pub fn set_fresh(&self, generation: Generation, estimate: Arc<EstimateDocument>) {
        let mut status = lock(&self.status);
        if status
            .used
            .in_verification
            .is_some_and(|(in_verification, _)| in_verification == generation)
        {
            status.verification = Some((generation, estimate));
        }
    }

    /// Counts a restart of the estimator and returns the number of restarts.
    pub fn count_restart(&self) -> u32 {
        let mut status = lock(&self.status);
        status.estimator_restarts = status.estimator_restarts.saturating_add(1);
        status.estimator_restarts
    }

    /// Returns the view of the robot for the rest of the service.
    pub fn view(&self, clock: &dyn Clock) -> RobotView {
        let stale = self.is_stale(clock);
        let topics = Arc::clone(&lock(&self.link).topics);
        let connection = {
            let link = lock(&self.link);
            let streams = Stream::ALL.iter().copied().zip(&link.streams);
            Connection {
                last_seen_ns: link.last_seen_ns,
                heard_before_ns: link.heard_before_ns,
                stale,
                alive: link.is_alive(),
                streams: streams
                    .filter(|(_, receipts)| receipts.messages > 0)
                    .map(|(stream, receipts)| StreamView {
                        stream,
                        messages: receipts.messages,
                        rate_hz: receipts.rate_hz(),
                        last_received_ns: receipts.last_received_ns,
                    })
                    .collect(),
            }
        };
        let (connection, counters) = self.mirrored(connection, self.mailbox.counters());
        let of_link = self.warning_of_former_key(clock).into_iter();
        let of_link = of_link.chain(Warning::topic_blocked(&topics));
        let estimated_by = self.estimated_by();
        let status = lock(&self.status);
        RobotView {
            id: self.id.clone(),
            config: status.config.clone(),
            state: status.state,
            connection,
            estimate: status.estimate.clone(),
            verification: status.verification.clone(),
            counters,
            estimator_restarts: status.estimator_restarts,
            pairing: status.pairing,
            warnings: status.warnings.iter().cloned().chain(of_link).collect(),
            checks: Arc::clone(&status.checks),
            reassembly_open: status.reassembly_open,
            notes_taken: status.notes_taken,
            topics,
            estimated_by,
        }
    }
}
