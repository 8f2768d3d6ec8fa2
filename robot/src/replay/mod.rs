//! Streams a recording over Zenoh as its robot would.
//!
//! The messages go out in the order in which they were logged, at a multiple of real time or as
//! fast as the service works. [`Window`] keeps the sender from running further ahead of
//! `{root}/{robot}/progress` than the robot's mailbox holds, so nothing is dropped. The robot's
//! liveliness token stands from before the first message until the last was worked through.

mod error;
mod link;
mod options;
mod window;

pub use error::ReplayError;
pub use options::{Pacing, Rate, RateRefused, ReplayOptions};
pub use window::{AHEAD_DRIVE_SAMPLES_MAX, AHEAD_SCANS_MAX, Report, Window};

use std::time::Duration;

use fleetcal_proto::message_type::MessageType;
use fleetcal_proto::ros2_key::typed_key;
use fleetcal_proto::{RobotId, StreamKind};
use tokio::sync::mpsc;
use tokio::time::Instant;

use crate::recording::{
    Channel, ChosenPose, ChosenWheelOdometry, RecordedMessage, Recording, RecordingError, Topics,
    choose_topics,
};
use link::{Lane, Link};

/// Messages that are read ahead from the file.
const READ_AHEAD_MAX: usize = 256;
/// ROS domain in the keys of topics that have no key of ours.
const ROS_DOMAIN: u32 = 0;
/// First pause between two queries for the service's progress.
const POLL_FIRST: Duration = Duration::from_millis(1);
/// Longest pause between two queries for the service's progress.
const POLL_LONGEST: Duration = Duration::from_millis(50);

/// Time without progress after which a service that was silent counts as having lost the messages
/// in flight.
const LOST_AFTER: Duration = Duration::from_secs(2);

/// Progress of a replay.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReplayProgress {
    /// Messages sent so far.
    pub sent: u64,
    /// Messages to send in all.
    pub total: u64,
    /// Sent part of the recording, ms.
    pub recording_ms: u64,
}

/// Summary of a replay.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReplaySummary {
    /// Id of the robot.
    pub robot: RobotId,
    /// Drive samples sent.
    pub drive_samples: u64,
    /// Scans or LiDAR poses sent.
    pub scans: u64,
    /// Messages that the service dropped because its mailbox was full, by its own report.
    pub dropped: u64,
    /// Messages in flight when the service was restarted: lost with it, or counted by nobody.
    pub unconfirmed: u64,
    /// Duration, from the first message until the service had processed the last.
    pub duration: Duration,
}

/// Streams a recording and waits until the service has processed it. Needs a tokio runtime with
/// more than one thread, as Zenoh does.
///
/// `on_progress` is called after every message.
///
/// # Errors
/// The recording or its topics can't be used, the service can't be reached or does not subscribe,
/// or it stops processing.
pub async fn replay(
    options: ReplayOptions,
    mut on_progress: impl FnMut(ReplayProgress) + Send,
) -> Result<ReplaySummary, ReplayError> {
    // 1. What to send, and as whom.
    let path = options.recording.clone();
    let recording = tokio::task::spawn_blocking(move || Recording::open(&path)).await??;
    let topics = choose_topics(recording.channels(), &options.topics)?;
    let robot = robot_of(&options, &topics)?;

    // 2. A session, in which somebody listens before anything is sent.
    let link = Link::open(&options, &robot, lanes(&options, &robot, &topics)).await?;
    link.wait_for_listeners(options.connect_timeout).await?;

    // 3. The messages, then the wait for the last of them.
    let mut sender = Sender {
        start_ns: recording.start_ns(),
        total: recording.count(&topics.names()),
        window: Window::new(link.progress().await?),
        started: Instant::now(),
        link,
        options,
    };
    let mut messages = read_ahead(&recording, &topics);
    while let Some(message) = messages.recv().await {
        on_progress(sender.send(message?).await?);
    }
    sender.wait_until_done().await?;

    // 4. Only now is the robot gone, so that the service's merger has everything to flush.
    let Sender {
        link,
        window,
        started,
        ..
    } = sender;
    let duration = started.elapsed();
    link.close().await?;
    Ok(ReplaySummary {
        robot,
        drive_samples: window.sent_drive_samples(),
        scans: window.sent_scans(),
        dropped: window.dropped(),
        unconfirmed: window.unconfirmed(),
        duration,
    })
}

/// Returns the requested robot, or the one that the topics name.
fn robot_of(options: &ReplayOptions, topics: &Topics) -> Result<RobotId, ReplayError> {
    if let Some(robot) = &options.robot {
        return Ok(robot.clone());
    }
    let topic = topics.wheel_odometry_topic();
    let named = topics.robot().ok_or_else(|| ReplayError::NoRobot {
        topic: topic.to_owned(),
    })?;
    let refused = |reason| ReplayError::RobotRefused {
        topic: topic.to_owned(),
        reason,
    };
    RobotId::parse(named).map_err(refused)
}

/// Returns the lane of each topic. Separate steering and speed have no key of ours: they are sent
/// in the form of `rmw_zenoh`.
fn lanes(options: &ReplayOptions, robot: &RobotId, topics: &Topics) -> Vec<Lane> {
    let own = |channel: &Channel, kind, usual| {
        let mut form = channel.form();
        form.message_type = form.message_type.filter(|&of| of != usual);
        Lane {
            topic: channel.topic.clone(),
            key: options.keys.stream(robot, kind),
            encoding: form.to_text(),
            is_wheel_odometry: kind == StreamKind::WheelOdometry,
        }
    };
    let of_ros = |channel: &Channel| {
        let below = channel.topic.trim_start_matches('/');
        let named = topics.robot().and_then(|name| below.strip_prefix(name));
        let below = named
            .and_then(|rest| rest.strip_prefix('/'))
            .unwrap_or(below);
        let path = format!("{ROS_DOMAIN}/{robot}/{below}");
        let form = channel.form();
        Lane {
            topic: channel.topic.clone(),
            key: form
                .message_type
                .map_or(path.clone(), |of| typed_key(&path, of)),
            encoding: form.encoding.as_str().to_owned(),
            is_wheel_odometry: true,
        }
    };
    let mut lanes = match &topics.wheel_odometry {
        ChosenWheelOdometry::Whole(channel) => vec![own(
            channel,
            StreamKind::WheelOdometry,
            MessageType::AckermannDriveStamped,
        )],
        ChosenWheelOdometry::Halves { steering, speed } => vec![of_ros(steering), of_ros(speed)],
    };
    lanes.push(match &topics.pose {
        ChosenPose::Scan(channel) => own(channel, StreamKind::Scan, MessageType::LaserScan),
        ChosenPose::LidarOdometry(channel) => {
            own(channel, StreamKind::LidarOdometry, MessageType::Odometry)
        }
    });
    lanes
}

/// Reads the file on a thread of its own, a bounded number of messages ahead.
fn read_ahead(
    recording: &Recording,
    topics: &Topics,
) -> mpsc::Receiver<Result<RecordedMessage, RecordingError>> {
    let (sender, receiver) = mpsc::channel(READ_AHEAD_MAX);
    let names = topics.names();
    let messages = recording.messages(&names);
    tokio::task::spawn_blocking(move || {
        let messages = match messages {
            Ok(messages) => messages,
            Err(error) => {
                // Nobody listens any more when the replay was given up.
                drop(sender.blocking_send(Err(error)));
                return;
            }
        };
        for message in messages {
            if sender.blocking_send(message).is_err() {
                return;
            }
        }
    });
    receiver
}

/// A recording being sent.
struct Sender {
    link: Link,
    options: ReplayOptions,
    window: Window,
    start_ns: u64,
    total: u64,
    started: Instant,
}

impl Sender {
    /// Sends one message when it is due and the service has room for it.
    async fn send(&mut self, message: RecordedMessage) -> Result<ReplayProgress, ReplayError> {
        let elapsed_ns = message.log_time_ns.saturating_sub(self.start_ns);
        if let Some(after) = self.options.rate.after(Duration::from_nanos(elapsed_ns)) {
            tokio::time::sleep_until(self.started + after).await;
        }
        let Some((lane, is_wheel_odometry)) = self.link.lane(&message.topic) else {
            return Ok(self.progress(elapsed_ns));
        };
        if self.options.pacing == Pacing::ByProgress {
            self.wait(|window| window.has_room(is_wheel_odometry))
                .await?;
        }
        self.link.send(lane, message.payload).await?;
        self.window.count_sent(is_wheel_odometry);
        Ok(self.progress(elapsed_ns))
    }

    fn progress(&self, elapsed_ns: u64) -> ReplayProgress {
        ReplayProgress {
            sent: self.window.sent(),
            total: self.total,
            recording_ms: elapsed_ns / 1_000_000,
        }
    }

    async fn wait_until_done(&mut self) -> Result<(), ReplayError> {
        self.wait(Window::is_done).await
    }

    /// Queries the service's progress until the window satisfies `ready`.
    async fn wait(&mut self, ready: impl Fn(&Window) -> bool) -> Result<(), ReplayError> {
        let mut pause = POLL_FIRST;
        let mut advanced_at = Instant::now();
        let mut silent_since_advance = false;
        while !ready(&self.window) {
            let progress = self.link.progress().await?;
            let report = progress.map(|progress| self.window.report(progress));
            if report == Some(Report::StartedAnew) {
                self.resume().await?;
            }
            if matches!(report, Some(Report::MovedOn | Report::StartedAnew)) {
                advanced_at = Instant::now();
                silent_since_advance = false;
                pause = POLL_FIRST;
                continue;
            }
            silent_since_advance |= report.is_none();
            let waited = advanced_at.elapsed();
            if silent_since_advance && report.is_some() && waited >= LOST_AFTER {
                // It was away and has nothing of ours any more.
                self.resume().await?;
                silent_since_advance = false;
            } else if waited >= self.options.stall_timeout {
                return Err(self.stalled(report.is_some()));
            }
            tokio::time::sleep(pause).await;
            pause = (2 * pause).min(POLL_LONGEST);
        }
        Ok(())
    }

    /// Continues with a service that was away: the messages in flight are abandoned.
    async fn resume(&mut self) -> Result<(), ReplayError> {
        self.link
            .wait_for_listeners(self.options.stall_timeout)
            .await?;
        if let Some(progress) = self.link.progress().await? {
            self.window.restart(progress);
        }
        Ok(())
    }

    fn stalled(&self, answered: bool) -> ReplayError {
        let robot = self.link.robot().clone();
        let seconds = self.options.stall_timeout.as_secs_f64();
        let sent = self.window.sent();
        if answered {
            let outstanding = self.window.outstanding();
            return ReplayError::Stalled {
                robot,
                seconds,
                sent,
                outstanding,
            };
        }
        ReplayError::NoProgress {
            robot,
            seconds,
            sent,
        }
    }
}

#[cfg(test)]
mod tests;
