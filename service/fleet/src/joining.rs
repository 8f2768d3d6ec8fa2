//! Joining checks of one robot: from its messages, as they come, to what is wrong with them.

use fleetcal_checks::{
    Cause, Checks, Described, Finding, Head, Inputs, State, StreamReport, Watch,
};
use fleetcal_domain::robot::{
    CheckFinding, CheckState, CheckedStream, ChecksReport, LeftOut, RobotConfig,
};
use fleetcal_estimator::lidar_odometry::OdometryPose;
use fleetcal_estimator::{Event, RobotTime, Scan};
use fleetcal_model::Stream;
use fleetcal_proto::ros::MeasuredDrive;

use crate::decode::MessageRefused;
use crate::intake::Taken;
use crate::sighting::{Sighted, Sighting};

/// The joining checks of a robot: [`Checks`] of a recording, or the [`Watch`] of a live one.
#[derive(Debug)]
pub struct JoiningChecks<C = Checks> {
    checks: C,
}

impl JoiningChecks {
    /// Checks of a robot's recording.
    pub fn of_recording(config: &RobotConfig) -> Self {
        Self {
            checks: Checks::new(described(config)),
        }
    }

    /// Returns the report, with the topic of each stream.
    pub fn report(&self, topic: impl Fn(Stream) -> String) -> ChecksReport {
        let Self { checks } = self;
        ChecksReport {
            way_m: checks.way_m(),
            resting: false,
            ..report(checks.streams(), checks.findings(), topic)
        }
    }
}

impl JoiningChecks<Watch> {
    /// Checks of a robot that sends, with the findings before.
    pub fn of_robot(config: &RobotConfig, former: &[CheckFinding]) -> Self {
        let finding = |one: &CheckFinding| {
            let cause = Cause::by_name(one.cause.as_deref()?)?;
            Some(Finding::named_before(cause, one.seen.clone()))
        };
        let former = former.iter().filter_map(finding).collect();
        Self {
            checks: Watch::new(described(config), former),
        }
    }

    /// Returns the report, with the topic of each stream.
    pub fn report(&self, topic: impl Fn(Stream) -> String) -> ChecksReport {
        let Self { checks } = self;
        ChecksReport {
            way_m: checks.way_m(),
            resting: checks.rests(),
            ..report(checks.streams(), checks.findings(), topic)
        }
    }
}

impl<C: Inputs> JoiningChecks<C> {
    /// Takes a message: what it says, and what it came to. `arrival_ns` is of a clock that is the same
    /// for all streams.
    pub fn take(
        &mut self,
        stream: Stream,
        arrival_ns: i64,
        sighting: Option<&Sighting>,
        taken: &Result<Taken, MessageRefused>,
    ) {
        if let Err(refused) = taken {
            self.refuse(stream, arrival_ns, &refused.to_string());
        }
        let Some(Sighting {
            stamp,
            frame,
            child_frame,
            content,
        }) = sighting
        else {
            return;
        };
        let head = Head {
            stream,
            stamp: *stamp,
            frame,
            child_frame: child_frame.as_deref(),
            arrival_ns,
        };
        match content {
            &Sighted::Wheels { speed, steering } => {
                self.checks.take_wheels(&head, speed, steering);
            }
            Sighted::Samples(samples) => self.take_samples(&head, samples),
            &Sighted::Scan { scan_time_s } => {
                if let Some(scan) = taken.as_ref().ok().and_then(scan_of) {
                    self.checks.take_scan(&head, scan, scan_time_s);
                }
            }
            &Sighted::Pose { pose, tilt_rad } => self.checks.take_pose(&head, pose, tilt_rad),
        }
    }

    /// Takes the drive samples of one message, each as if it had been sent when it was measured.
    fn take_samples(&mut self, message: &Head<'_>, samples: &[MeasuredDrive]) {
        for sample in samples {
            let stamp = RobotTime(sample.stamp.as_ns());
            let head = Head {
                stamp,
                arrival_ns: message.arrival_ns - message.stamp.0 + stamp.0,
                ..*message
            };
            let (speed, steering) = (sample.speed.into(), sample.steering_angle.into());
            self.checks.take_wheels(&head, Some(speed), Some(steering));
        }
    }

    /// Notes that a message was refused, and why.
    pub fn refuse(&mut self, stream: Stream, arrival_ns: i64, reason: &str) {
        if stream != Stream::Event {
            self.checks.refuse(stream, arrival_ns, reason);
        }
    }

    /// Takes the pose that LiDAR odometry gives the latest scan.
    pub fn take_odometry(&mut self, pose: &OdometryPose) {
        self.checks.take_odometry(pose);
    }
}

fn described(config: &RobotConfig) -> Described {
    Described {
        model: config.model,
        speed_measured_at: config.vehicle().speed_measured_at,
        wheelbase_m: config.wheelbase_m.metres(),
        nominal_yaw_rad: config.nominal_extrinsics.map(|mount| mount.pose().yaw_rad),
    }
}

fn report(
    streams: Vec<StreamReport>,
    findings: Vec<Finding>,
    topic: impl Fn(Stream) -> String,
) -> ChecksReport {
    ChecksReport {
        streams: streams
            .into_iter()
            .map(|report| {
                let topic = topic(report.stream);
                stream_of(report, topic)
            })
            .collect(),
        findings: findings.into_iter().map(finding_of).collect(),
        ..ChecksReport::default()
    }
}

fn stream_of(report: StreamReport, topic: String) -> CheckedStream {
    let mut stream = CheckedStream {
        stream: report.stream.name().to_owned(),
        topic,
        messages: report.messages,
        refused: report.refused,
        first_refusal: report.first_refusal,
        left_out: Vec::new(),
        rate_hz: report.rate_hz,
        period_ms: report.period_ms,
        age_ms: report.age_ms,
        uneven_ms: report.uneven_ms,
        repeated: report.repeated,
        late: report.late,
        gaps: report.gaps,
        longest_gap_s: report.longest_gap_s,
        frames: report.frames,
    };
    leave_out(&mut stream, "refused", report.refused);
    stream
}

/// Adds messages that were not used, for one reason, to the report on their stream.
pub(crate) fn leave_out(stream: &mut CheckedStream, reason: &str, messages: u64) {
    if messages > 0 {
        let share = messages as f64 / stream.messages.max(messages) as f64;
        stream.left_out.push(LeftOut {
            reason: reason.to_owned(),
            messages,
            share,
        });
    }
}

fn finding_of(finding: Finding) -> CheckFinding {
    let named = finding.cause.is_some();
    CheckFinding {
        check: finding.check.name().to_owned(),
        state: match finding.state {
            State::Ok => CheckState::Ok,
            State::Wrong => CheckState::Wrong,
            State::Unsure => CheckState::Unsure,
            State::NotYet => CheckState::NotYet,
        },
        cause: finding.cause.map(|cause| cause.name().to_owned()),
        advice: finding.advice().map(str::to_owned),
        after_m: named.then_some(finding.after_m),
        after_s: named.then_some(finding.after_s),
        spoils_values: finding.cause.is_some_and(Cause::spoils_values),
        seen: finding.seen,
    }
}

/// The scan that a message came to.
pub fn scan_of(taken: &Taken) -> Option<&Scan> {
    taken
        .events
        .iter()
        .find_map(|decoded| match &decoded.event {
            Event::Scan(scan) => Some(scan),
            _ => None,
        })
}
