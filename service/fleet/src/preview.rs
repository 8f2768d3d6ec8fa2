//! Previews of unregistered robots: their messages, read and checked by a configuration that is not
//! stored. Messages wait until somebody requests the preview, and are read then: a robot at which
//! nobody looks costs nothing.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use fleetcal_checks::Watch;
use fleetcal_domain::limits::{
    PREVIEW_BYTES_MAX, PREVIEW_KEPT, PREVIEW_MESSAGES_MAX, PREVIEWS_MAX,
};
use fleetcal_domain::robot::{ChecksReport, RobotConfig};
use fleetcal_domain::streams::RobotStreams;
use fleetcal_estimator::calibrator::TopView;
use fleetcal_estimator::{Calibrator, Effect, EstimatorSettings};
use fleetcal_model::Stream;
use fleetcal_proto::RobotId;

use crate::intake::Intake;
use crate::joining::JoiningChecks;
use crate::mailbox::Message;
use crate::reading::ReadingSettings;
use crate::top_view;

/// Content of an unregistered robot's messages, by a configuration that is not stored.
#[derive(Debug)]
pub struct Preview {
    /// Joining checks of its messages.
    pub checks: ChecksReport,
    /// Top view; `None` before the first scan or pose.
    pub top_view: Option<TopView>,
    /// Messages that were dropped because too many came between two requests.
    pub dropped: u64,
}

/// Previews of all robots, in the order in which they were begun.
#[derive(Debug, Default)]
pub(crate) struct Previews(Mutex<Vec<Arc<Previewed>>>);

/// Locks a mutex. What it guards is whole after every statement, or dropped after a panic.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Previews {
    /// Finds the preview of a robot by a configuration, or begins one; returns it, and whether it was
    /// begun. `None` if there are [`PREVIEWS_MAX`] of as many other robots.
    pub(crate) fn ask(
        &self,
        robot: &RobotId,
        config: RobotConfig,
        defaults: &EstimatorSettings,
        now: Duration,
    ) -> Option<(Arc<Previewed>, bool)> {
        let mut all = lock(&self.0);
        let is_it = |one: &&Arc<Previewed>| one.robot == *robot && one.config == config;
        if let Some(known) = all.iter().find(is_it) {
            lock(&known.waiting).asked = now;
            return Some((Arc::clone(known), false));
        }
        if all.len() >= PREVIEWS_MAX {
            let place = dispensable(&all, robot)?;
            all.remove(place);
        }
        let begun = Arc::new(Previewed::new(robot.clone(), config, defaults, now));
        all.push(Arc::clone(&begun));
        Some((begun, true))
    }

    /// Keeps a message of a robot for each of its previews, except notes.
    pub(crate) fn keep(&self, robot: &RobotId, stream: Stream, message: impl FnOnce() -> Message) {
        if stream == Stream::Event {
            return;
        }
        let is_of = |one: &&Arc<Previewed>| one.robot == *robot;
        let found: Vec<_> = lock(&self.0).iter().filter(is_of).cloned().collect();
        if let Some((last, others)) = found.split_last() {
            let message = message();
            for other in others {
                lock(&other.waiting).push(message.clone());
            }
            lock(&last.waiting).push(message);
        }
    }

    /// Drops the previews of a robot; returns whether there were any.
    pub(crate) fn end(&self, robot: &RobotId) -> bool {
        let mut all = lock(&self.0);
        let before = all.len();
        all.retain(|one| one.robot != *robot);
        all.len() < before
    }

    /// Drops the previews that nobody has requested for [`PREVIEW_KEPT`]; returns whether there were
    /// any.
    pub(crate) fn tick(&self, now: Duration) -> bool {
        let mut all = lock(&self.0);
        let before = all.len();
        all.retain(|one| now.saturating_sub(lock(&one.waiting).asked) < PREVIEW_KEPT);
        all.len() < before
    }

    /// Returns the topics of the robots that have a preview: of several of one robot, those of the
    /// preview that was begun last.
    pub(crate) fn streams(&self) -> BTreeMap<RobotId, RobotStreams> {
        let all = lock(&self.0);
        let streams = |one: &Arc<Previewed>| (one.robot.clone(), one.config.streams.clone());
        all.iter().map(streams).collect()
    }
}

/// Returns the place of the preview that ends for another one of this robot: the least recently
/// requested of those that are the robot's, or of a robot that has several.
fn dispensable(all: &[Arc<Previewed>], robot: &RobotId) -> Option<usize> {
    let count = |of: &RobotId| all.iter().filter(|one| one.robot == *of).count();
    let may_end = |one: &Previewed| one.robot == *robot || count(&one.robot) > 1;
    let places = (0..all.len()).filter(|&place| may_end(&all[place]));
    places.min_by_key(|&place| lock(&all[place].waiting).asked)
}

/// Messages that wait for the next request.
#[derive(Debug)]
struct Waiting {
    messages: VecDeque<Message>,
    bytes: usize,
    dropped: u64,
    /// Running time of the last request.
    asked: Duration,
}

impl Waiting {
    fn push(&mut self, message: Message) {
        self.bytes += message.payload.len();
        self.messages.push_back(message);
        while self.messages.len() > PREVIEW_MESSAGES_MAX || self.bytes > PREVIEW_BYTES_MAX {
            let Some(oldest) = self.messages.pop_front() else {
                return;
            };
            self.bytes -= oldest.payload.len();
            self.dropped += 1;
        }
    }
}

/// Preview of one robot by one configuration.
#[derive(Debug)]
pub(crate) struct Previewed {
    robot: RobotId,
    config: RobotConfig,
    waiting: Mutex<Waiting>,
    reader: Mutex<Reader>,
}

impl Previewed {
    fn new(
        robot: RobotId,
        config: RobotConfig,
        defaults: &EstimatorSettings,
        now: Duration,
    ) -> Self {
        Self {
            robot,
            reader: Mutex::new(Reader::new(&config, defaults)),
            waiting: Mutex::new(Waiting {
                messages: VecDeque::new(),
                bytes: 0,
                dropped: 0,
                asked: now,
            }),
            config,
        }
    }

    /// Reads the waiting messages and reports what has come so far.
    pub(crate) fn read(&self) -> Preview {
        let mut reader = lock(&self.reader);
        let (messages, dropped) = {
            let mut waiting = lock(&self.waiting);
            waiting.bytes = 0;
            (std::mem::take(&mut waiting.messages), waiting.dropped)
        };
        for message in &messages {
            reader.take(message);
        }
        Preview {
            checks: reader.report(),
            top_view: reader.calibrator.top_view(&top_view::LIMITS),
            dropped,
        }
    }
}

/// Reader of the messages: what a robot's task does with them, without a robot.
#[derive(Debug)]
struct Reader {
    intake: Intake,
    checks: JoiningChecks<Watch>,
    calibrator: Calibrator,
}

impl Reader {
    fn new(config: &RobotConfig, defaults: &EstimatorSettings) -> Self {
        Self {
            intake: Intake::new(ReadingSettings::of(config)),
            checks: JoiningChecks::of_robot(config, &[]),
            calibrator: Calibrator::new(config.basis(defaults).calibrator),
        }
    }

    fn take(&mut self, message: &Message) {
        let read = message.as_read();
        let taken = self.intake.take(&read);
        let sighting = self.intake.sight(&read);
        let arrival_ns = message.arrived_ns.0;
        self.checks
            .take(message.stream, arrival_ns, sighting.as_ref(), &taken);
        for decoded in taken.into_iter().flat_map(|taken| taken.events) {
            for effect in self.calibrator.step(decoded.event) {
                if let Effect::LidarMoved(pose) = effect {
                    self.checks.take_odometry(&pose);
                }
            }
        }
    }

    fn report(&self) -> ChecksReport {
        let topic = |stream: Stream| {
            self.intake
                .topic(stream)
                .unwrap_or(stream.name())
                .to_owned()
        };
        self.checks.report(topic)
    }
}
