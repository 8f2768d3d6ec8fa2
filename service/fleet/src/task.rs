//! One robot's task: takes what waits in the mailbox, feeds the pure estimator, and does what the
//! estimator asks for.

mod checkpoints;
mod checks;
mod configuration;
mod good;
mod heard;
mod live_checks;
mod notes;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering;

use fleetcal_domain::limits::{ADVICE_EVERY_S, ESTIMATOR_RESTARTS_MAX};
use fleetcal_domain::robot::{
    Basis, HistoryEvent, Mount, RobotConfig, RobotState, ServiceEvent, ServiceEventKind,
    WheelOdometrySignal,
};
use fleetcal_estimator::calibrator::TopView;
use fleetcal_estimator::{Calibrator, Effect, Event, RobotTime};
use fleetcal_model::{ChangeKind, Parameter, ParameterStatus, Stream, Version};
use fleetcal_proto::RecordingTopic;
use fleetcal_proto::estimate::EstimateDocument;
use fleetcal_proto::message_type::Form;

use crate::budgets::HistoryBudgets;
use crate::candidate::Candidate;
use crate::decode::{self, Decoded};
use crate::document;
use crate::intake::{Intake, Taken};
use crate::live::LiveUpdate;
use crate::mailbox::{Item, Message, Outcome};
use crate::notes::NotesTaken;
use crate::pose::LatestPose;
use crate::reading::ReadingSettings;
use crate::registry::Fleet;
use crate::robot::Robot;
use crate::senders::{Origin, Senders, Sent};
use crate::stored::{self, Restored};
use crate::tapped::Tapped;
use crate::top_view;
use crate::verification_run::VerificationRun;
use good::Good;
use heard::Known;
use live_checks::LiveChecks;

/// Parameters that have to be known before a robot counts as calibrated.
const CALIBRATED: [Parameter; 4] = [
    Parameter::SteeringOffset,
    Parameter::LidarX,
    Parameter::LidarY,
    Parameter::LidarYaw,
];

/// State of the estimator.
#[derive(Debug)]
enum Engine {
    /// Running.
    Running(Box<Calibrator>),
    /// Stopped, because it failed too often.
    Stopped,
}

#[derive(Debug)]
pub struct RobotTask {
    pub(crate) fleet: Arc<Fleet>,
    pub(crate) robot: Arc<Robot>,
    version: Version,
    signal: WheelOdometrySignal,
    reading: ReadingSettings,
    intake: Intake,
    /// Joining checks of its messages.
    checks: LiveChecks,
    rear_axle_in_base_link: Option<Mount>,
    /// Basis of the estimate.
    basis: Basis,
    engine: Engine,
    /// Last stored state, the restart point after a panic.
    last_good: Option<Good>,
    /// State before that one: when two senders are detected, the last may contain data of both.
    earlier_good: Option<Good>,
    /// Detector of two senders that use the robot's id.
    senders: Senders,
    budgets: HistoryBudgets,
    checkpointed: Option<RobotTime>,
    /// Time of the last ranking of manoeuvres.
    advised: Option<RobotTime>,
    newest: RobotTime,
    /// Last pose of the rear axle that was passed to the readers.
    tapped_pose: LatestPose,
    /// Last top view that was requested, and the newest message at that time.
    top_view: Option<(RobotTime, Arc<TopView>)>,
    /// True if a change was detected and the new values are not known yet.
    changed: bool,
    /// Verification run of the values that the robot has begun to use.
    verification_run: Option<VerificationRun>,
    /// Early messages that the restored state covers.
    known: Option<Known>,
    /// Notes that the estimator has processed.
    notes: NotesTaken,
}

impl RobotTask {
    pub(crate) fn start(
        fleet: Arc<Fleet>,
        robot: Arc<Robot>,
        version: Version,
        config: &RobotConfig,
        stored: Option<&[u8]>,
    ) -> Self {
        let signal = config.wheel_odometry;
        let rear_axle_in_base_link = config.rear_axle_in_base_link;
        let reading = ReadingSettings::of(config);
        let basis = config.basis(&fleet.estimator);
        let restored = stored.and_then(|bytes| stored::restore(&robot.id, &basis, bytes));
        let last_good = restored.as_ref().map(|one| Good {
            checkpoint: one.calibrator.checkpoint(),
            changed: one.changed,
        });
        let restored = restored.unwrap_or_else(|| Restored::nothing(&basis.calibrator));
        let notes = restored.notes;
        let notes = notes.unwrap_or_else(|| NotesTaken::until(fleet.audited));
        let known = last_good
            .as_ref()
            .map(|_| Known::by(&restored.calibrator, notes.of_robot.clone()));
        let task = Self {
            fleet,
            robot,
            version,
            signal,
            intake: Intake::new(reading.clone()),
            checks: LiveChecks::new(config, &restored.findings),
            reading,
            rear_axle_in_base_link,
            basis,
            engine: Engine::Running(Box::new(restored.calibrator)),
            earlier_good: last_good.clone(),
            last_good,
            senders: Senders::default(),
            budgets: HistoryBudgets::default(),
            checkpointed: None,
            advised: None,
            newest: RobotTime(0),
            tapped_pose: LatestPose::default(),
            top_view: None,
            changed: restored.changed,
            verification_run: restored.verification_run,
            known,
            notes,
        };
        if task.last_good.is_some() {
            task.show_checks();
        }
        task.show_estimate(restored.candidate);
        // Those that came after it was stored, or while no task was there, are brought now.
        task.robot.set_reassembly_open(task.is_reassembly_open());
        task.robot.set_notes_taken(task.notes.until);
        task.robot.want_notes();
        task
    }

    /// Shows the estimate that the task continues from, or nothing where that is of no data.
    fn show_estimate(&self, candidate: Candidate) {
        let Engine::Running(calibrator) = &self.engine else {
            return;
        };
        let estimate = calibrator.estimate();
        let mut document = document::estimate_document(&self.robot.id, &estimate);
        document.motions = Some(document::motions(calibrator));
        if estimate.stamp.0 > 0 && document::is_finite(&document) {
            self.place_in_base_link(&mut document);
            self.give_way(&mut document);
            let state = state_of(&document, self.changed);
            self.robot.restore(state, Arc::new(document), candidate);
        } else {
            self.robot.show_nothing();
        }
    }

    pub(crate) fn take(&mut self, item: Item) {
        self.follow_config();
        match item {
            Item::Message(message) => {
                self.known = None;
                self.take_and_count(&message);
            }
            Item::Heard(message) => self.take_and_count(&message),
            Item::Note(noted) => self.take_noted(&noted),
            Item::EndOfSession => {
                self.step(Event::EndOfSession);
                self.save_checkpoint();
            }
            Item::ValuesHeard => {
                self.robot.values_heard(self.newest);
                if let Some(verification_run) = &self.verification_run {
                    verification_run.show(&self.robot);
                }
            }
        }
    }

    fn take_and_count(&mut self, message: &Message) {
        let began = self.fleet.clock.elapsed();
        let outcome = self.take_message(message);
        self.fleet.took(message, began);
        if let Outcome::Refused(reason) = &outcome {
            tracing::debug!(robot.id = %self.robot.id, reason, "message refused");
        }
        self.robot.mailbox.finish(outcome);
    }

    fn take_message(&mut self, message: &Message) -> Outcome {
        let Message {
            stream,
            form,
            origin,
            payload,
            ..
        } = message;
        let taken = self.intake.take(&message.as_read());
        let sent = taken.as_ref();
        if sent.is_ok_and(|taken| self.is_of_two_senders(*stream, taken, *origin)) {
            return Outcome::Refused("two senders use the robot's id".to_owned());
        }
        self.check(message, &taken);
        let taken = match taken {
            Ok(taken) => taken,
            Err(refused) => return Outcome::Refused(refused.to_string()),
        };
        if let Some(topic) = self.recording_topic(*stream, *form) {
            self.robot.taps.offer_message(taken.stamp, topic, payload);
        }
        if let Some(pairing) = self.intake.pairing() {
            self.robot.set_pairing(pairing);
        }
        let mut events = taken.events;
        if let Some(known) = &mut self.known {
            if *stream != Stream::Event {
                known.hear(taken.stamp);
            }
            let nothing_follows = events.is_empty() && known.has_half(taken.stamp);
            let count = events.len();
            events.retain(|decoded| !known.has(&decoded.event));
            if nothing_follows || events.is_empty() && count > 0 {
                return Outcome::Known;
            }
        }
        self.process(taken.stamp, events)
    }

    /// Processes the events of a message, all of them or none.
    fn process(&mut self, stamp_ns: RobotTime, mut events: Vec<Decoded>) -> Outcome {
        for decoded in &mut events {
            match self.raw(&decoded.event) {
                Ok(Some(raw)) => decoded.event = raw,
                Ok(None) => {}
                Err(reason) => return Outcome::Refused(reason),
            }
        }
        let of_wheels = |decoded: &&Decoded| matches!(decoded.event, Event::WheelOdometry(_));
        let drive_samples = events.iter().filter(of_wheels).count() as u64;
        for decoded in events {
            let outcome = self.take_decoded(decoded);
            if let Outcome::Refused(_) = outcome {
                return outcome;
            }
        }
        Outcome::Processed {
            stamp_ns,
            drive_samples,
        }
    }

    /// True if two senders use the robot's id at once: then the messages of both are dropped, and
    /// everything learnt before they were told apart is discarded.
    fn is_of_two_senders(&mut self, stream: Stream, taken: &Taken, origin: Option<Origin>) -> bool {
        let were_two = self.senders.are_two();
        let sent = Sent {
            stamp: taken.stamp,
            content: taken.content,
            origin,
            steering_rad: taken.steering_rad,
        };
        let are_two = self.senders.take(stream, &sent);
        let counts = &self.fleet.counts;
        let (missing, of_two) = (self.senders.missing(stream), u64::from(are_two));
        counts.missing.fetch_add(missing, Ordering::Relaxed);
        counts.of_two_senders.fetch_add(of_two, Ordering::Relaxed);
        if are_two && !were_two {
            self.begin_checks();
            self.verification_run = None;
            self.last_good = self.earlier_good.take();
            self.begin_from(self.last_good.clone());
            self.save_checkpoint();
        }
        if are_two != were_two {
            self.warn();
        }
        are_two
    }

    /// Returns the topic of a stream in a recording; `None` for messages that are not of ROS 2.
    fn recording_topic(&self, stream: Stream, form: Form) -> Option<RecordingTopic> {
        let name = self.intake.topic(stream).unwrap_or(stream.name());
        Some(RecordingTopic {
            topic: format!("/{}/{name}", self.robot.id),
            message_type: self.intake.message_type(stream, form)?,
            encoding: form.encoding,
        })
    }

    fn take_decoded(&mut self, decoded: Decoded) -> Outcome {
        let Decoded { stamp, event, note } = decoded;
        if let Some(note) = note {
            return self.take_robots_note(note);
        }
        if !self.step(event) {
            return Outcome::Refused("the robot's estimator is stopped after a fault".to_owned());
        }
        self.newest = self.newest.max(stamp);
        let due = |last: Option<RobotTime>, every_s: f64| {
            last.is_none_or(|last| stamp.seconds_since(last) >= every_s || stamp < last)
        };
        if due(self.checkpointed, self.checkpoint_every_s()) {
            self.checkpointed = Some(stamp);
            self.save_checkpoint();
        }
        if due(self.advised, ADVICE_EVERY_S) {
            self.advised = Some(stamp);
            self.advise();
        }
        if self.robot.state() == RobotState::NoData {
            self.robot.set_state(RobotState::Learning);
        }
        Outcome::Processed {
            stamp_ns: stamp,
            drive_samples: 0,
        }
    }

    /// Ranks the manoeuvres that the robot should drive next, and updates the warnings.
    fn advise(&self) {
        self.warn();
        if let Engine::Running(calibrator) = &self.engine {
            // Where a value cannot be right, no manoeuvre makes it so.
            let ranked = match self.robot.checks().spoiling() {
                Some(_) => Vec::new(),
                None => calibrator.next_manoeuvres(None),
            };
            self.robot.set_manoeuvres(ranked);
        }
    }

    /// Draws the robot's top view for the waiting requests.
    pub(crate) fn answer_top_view_askers(&mut self) {
        let askers = self.robot.top_view_askers.take();
        if askers.is_empty() {
            return;
        }
        let view = self.top_view_now();
        for asker in askers {
            drop(asker.send(view.clone()));
        }
    }

    fn top_view_now(&mut self) -> top_view::Answer {
        let newest = self.newest;
        let is_recent = |at: RobotTime| newest.seconds_since(at).abs() < top_view::EVERY_S;
        if let Some((at, view)) = &self.top_view
            && is_recent(*at)
        {
            return Some(Arc::clone(view));
        }
        let Engine::Running(calibrator) = &self.engine else {
            return None;
        };
        let drawn = catch_unwind(AssertUnwindSafe(|| calibrator.top_view(&top_view::LIMITS)));
        let view = drawn.unwrap_or_else(|_| {
            self.fleet.count_panic();
            tracing::error!(robot.id = %self.robot.id, "the top view could not be drawn up");
            None
        });
        self.top_view = view.map(|view| (newest, Arc::new(view)));
        self.top_view.as_ref().map(|(_, view)| Arc::clone(view))
    }

    /// Restores the sensor's values where the robot compensates before it sends; `None` where it
    /// does not.
    fn raw(&self, event: &Event) -> Result<Option<Event>, String> {
        let Event::WheelOdometry(sample) = event else {
            return Ok(None);
        };
        if self.signal == WheelOdometrySignal::Raw {
            return Ok(None);
        }
        let Some(values) = self.robot.values_at(sample.stamp()) else {
            return Err(
                "wheel_odometry: the robot is declared compensated and has not reported what it \
                 applies; expected is wheel_odometry = \"raw\" until then"
                    .to_owned(),
            );
        };
        decode::added_back(sample, &values)
            .map(|raw| Some(Event::WheelOdometry(raw)))
            .map_err(|refused| refused.to_string())
    }

    /// Feeds the estimator and the verification run. Returns `false` if the estimator is stopped,
    /// or failed on this event.
    pub(crate) fn step(&mut self, event: Event) -> bool {
        let scanner = || match &self.engine {
            Engine::Running(calibrator) => Some(calibrator.learnt_scanner()),
            Engine::Stopped => None,
        };
        self.verification_run = VerificationRun::follow(
            self.verification_run.take(),
            &self.robot,
            &self.basis.calibrator,
            scanner,
        )
        .and_then(|verification_run| verification_run.take(&self.robot, &event));
        let Engine::Running(calibrator) = &mut self.engine else {
            return false;
        };
        // After a panic the calibrator may be half changed: it is thrown away.
        let step = self.fleet.step;
        let Ok(effects) = catch_unwind(AssertUnwindSafe(|| step(calibrator, event))) else {
            self.restart("it panicked");
            return false;
        };
        for effect in effects {
            if !self.perform(effect) {
                self.restart("its numbers are no longer finite");
                return false;
            }
        }
        if self.robot.taps.is_open() {
            self.tap_pose();
        }
        true
    }

    /// Passes a new pose of the rear axle to the readers.
    fn tap_pose(&mut self) {
        let Engine::Running(calibrator) = &self.engine else {
            return;
        };
        if let Some((stamp, pose)) = self.tapped_pose.advance(calibrator) {
            self.robot.taps.offer(Tapped::Pose(stamp, pose));
        }
    }

    /// Performs an effect of the estimator. Returns `false` if its estimate is invalid.
    fn perform(&mut self, effect: Effect) -> bool {
        match effect {
            Effect::Estimate(estimate) => {
                let mut document = document::estimate_document(&self.robot.id, &estimate);
                if !document::is_finite(&document) {
                    return false;
                }
                if let Engine::Running(calibrator) = &self.engine {
                    document.motions = Some(document::motions(calibrator));
                }
                self.publish(document);
            }
            Effect::Change(change) => {
                let change = document::change_document(&change);
                self.changed |= change.kind == ChangeKind::CalibrationChanged;
                let taps = &self.robot.taps;
                taps.offer(Tapped::Change(change.clone()));
                self.budgets
                    .record(&self.fleet, &self.robot.id, HistoryEvent::Change(change));
            }
            // The same event, complete: the journal keeps it once.
            Effect::ChangeSized(change) => {
                let change = document::change_document(&change);
                let taps = &self.robot.taps;
                taps.offer(Tapped::Change(change.clone()));
                self.budgets
                    .record(&self.fleet, &self.robot.id, HistoryEvent::Change(change));
            }
            Effect::Dropped(dropped) => self.leave_out(dropped),
            Effect::LidarMoved(pose) => self.checks.take_odometry(&pose),
            Effect::SessionStarted(stamp) => {
                self.robot.clock_went_back();
                self.record_service_event(ServiceEventKind::SessionStarted, stamp, String::new());
            }
        }
        true
    }

    /// Adds the LiDAR's pose in the vehicle's own frame, where that is configured.
    fn place_in_base_link(&self, document: &mut EstimateDocument) {
        let rear_axle = self.rear_axle_in_base_link.as_ref();
        document.lidar_in_base_link =
            rear_axle.map(|axle| document::lidar_in_base_link(axle, &document.parameters));
    }

    fn publish(&mut self, mut document: EstimateDocument) {
        self.place_in_base_link(&mut document);
        self.give_way(&mut document);
        let state = state_of(&document, self.changed);
        self.changed = state == RobotState::Changed;
        let document = Arc::new(document);
        let taps = &self.robot.taps;
        taps.offer(Tapped::Estimate(Arc::clone(&document)));
        self.robot.set_state(state);
        self.robot.set_reassembly_open(document.reassembly_open);
        self.robot.set_estimate(Arc::clone(&document));
        self.fleet.journal.record_history(&self.robot.id, &document);
        let robot = self.robot.id.clone();
        self.fleet
            .announce(LiveUpdate::Estimate { robot, document });
    }

    /// Restarts the estimator after a fault: from the last stored state, and from nothing when
    /// that fails before it could be stored again.
    fn restart(&mut self, why: &str) {
        self.fleet.count_panic();
        let restarts = self.robot.count_restart();
        if restarts > ESTIMATOR_RESTARTS_MAX {
            tracing::error!(robot.id = %self.robot.id, restarts, "estimator stopped: {why}");
            self.engine = Engine::Stopped;
            self.robot.set_state(RobotState::Failed);
            let note = format!("{why}, {restarts} times");
            self.record_service_event(ServiceEventKind::EstimatorStopped, self.newest, note);
            return;
        }
        tracing::error!(robot.id = %self.robot.id, restarts, "estimator restarted: {why}");
        let last_good = self.last_good.take();
        self.begin_from(last_good);
        let note = why.to_owned();
        self.record_service_event(ServiceEventKind::EstimatorRestarted, self.newest, note);
    }

    /// Continues from a state, or from nothing in the absence of a usable one, and shows that. A
    /// reported reassembly stays open.
    fn begin_from(&mut self, good: Option<Good>) {
        let was_open = self.robot.is_reassembly_open();
        if let Some(good) = &good {
            self.changed = good.changed;
        }
        let restored = good.and_then(|good| {
            Calibrator::restore(self.basis.calibrator.clone(), &good.checkpoint).ok()
        });
        let calibrator = restored.unwrap_or_else(|| Calibrator::new(self.basis.calibrator.clone()));
        self.engine = Engine::Running(Box::new(calibrator));
        self.top_view = None;
        self.show_estimate(Candidate::default());
        if was_open && !self.is_reassembly_open() {
            self.reopen_reassembly();
        }
        self.robot.set_reassembly_open(self.is_reassembly_open());
    }

    fn record_service_event(&mut self, kind: ServiceEventKind, stamp: RobotTime, note: String) {
        let event = ServiceEvent {
            kind,
            stamp_ns: stamp,
            note,
        };
        let taps = &self.robot.taps;
        taps.offer(Tapped::of_service_event(&event));
        self.budgets
            .record(&self.fleet, &self.robot.id, HistoryEvent::Service(event));
    }
}

/// Returns a robot's state by its estimate.
fn state_of(document: &EstimateDocument, changed: bool) -> RobotState {
    let known = CALIBRATED.iter().all(|&name| {
        use ParameterStatus as S;
        let status = document.parameters.get(name).status;
        matches!(status, S::Converged | S::Fixed | S::Off)
    });
    match (known, changed) {
        (true, _) => RobotState::Calibrated,
        (false, true) => RobotState::Changed,
        (false, false) => RobotState::Learning,
    }
}
