//! Joining checks of a robot, as its task feeds and shows them, and the warnings about its messages.

use std::sync::atomic::Ordering;

use fleetcal_domain::limits::CHECKS_SHOWN_EVERY_S;
use fleetcal_domain::robot::{ChecksReport, Warning};
use fleetcal_estimator::Dropped;
use fleetcal_estimator::lidar_odometry::BeamTimes;
use fleetcal_model::Stream;
use fleetcal_proto::estimate::EstimateDocument;

use super::live_checks::LiveChecks;
use super::{Engine, RobotTask};
use crate::decode::MessageRefused;
use crate::document;
use crate::intake::Taken;
use crate::joining::leave_out;
use crate::left_out::LeftOutReason;
use crate::mailbox::Message;

impl RobotTask {
    /// Takes a message to the checks: what it says, and what it came to.
    pub(super) fn check(&mut self, message: &Message, taken: &Result<Taken, MessageRefused>) {
        let Message {
            stream, arrived_ns, ..
        } = *message;
        self.checks.stream = stream;
        let sighting = self.intake.sight(&message.as_read());
        let joining = &mut self.checks.joining;
        joining.take(stream, arrived_ns.0, sighting.as_ref(), taken);
        if let Some(pairing) = self.intake.pairing() {
            let unpaired = pairing.unpaired.saturating_sub(self.checks.unpaired);
            self.checks.unpaired = pairing.unpaired;
            self.count_left_out(Stream::Speed, LeftOutReason::Unpaired, unpaired);
        }
        let since_ns = arrived_ns.ns_since(self.checks.shown_ns);
        if (since_ns as f64 * 1e-9).abs() >= CHECKS_SHOWN_EVERY_S {
            self.checks.shown_ns = arrived_ns;
            if self.show_checks() {
                self.warn();
            }
        }
    }

    /// Counts a message that the estimator left out.
    pub(super) fn leave_out(&mut self, dropped: Dropped) {
        let (stream, reason) = match dropped {
            Dropped::Late => (self.checks.stream, LeftOutReason::Late),
            Dropped::Duplicate => (self.checks.stream, LeftOutReason::Duplicate),
            Dropped::UnusableScan => (Stream::Scan, LeftOutReason::Unusable),
        };
        self.count_left_out(stream, reason, 1);
    }

    fn count_left_out(&mut self, stream: Stream, reason: LeftOutReason, messages: u64) {
        self.checks.count(stream, reason, messages);
        if let Some(count) = self.fleet.counts.left_out.get(reason as usize) {
            count.fetch_add(messages, Ordering::Relaxed);
        }
    }

    /// Begins the checks from nothing.
    pub(super) fn begin_checks(&mut self) {
        if let Some((_, config)) = self.robot.versioned_config() {
            self.checks = LiveChecks::new(&config, &[]);
        }
    }

    /// Shows the checks; returns whether they name other causes than before.
    pub(super) fn show_checks(&self) -> bool {
        let topic = |stream: Stream| {
            self.intake
                .topic(stream)
                .unwrap_or(stream.name())
                .to_owned()
        };
        let mut report = self.checks.joining.report(topic);
        self.add_left_out(&mut report);
        self.robot.set_checks(report)
    }

    /// Adds the messages that were not used to the streams.
    fn add_left_out(&self, report: &mut ChecksReport) {
        let counters = self.robot.mailbox.counters();
        for (of, counts) in Stream::ALL.iter().zip(&self.checks.left_out) {
            let mut streams = report.streams.iter_mut();
            let Some(stream) = streams.find(|stream| stream.stream == of.name()) else {
                continue;
            };
            for (reason, messages) in LeftOutReason::ALL.iter().zip(counts) {
                leave_out(stream, reason.name(), *messages);
            }
            // A mailbox counts by class: of the streams of one, the first that comes stands for it.
            let full = match of {
                Stream::WheelOdometry | Stream::Speed => counters.dropped_wheel_odometry,
                Stream::Scan | Stream::LidarOdometry => counters.dropped_scans,
                Stream::Steering | Stream::Event => 0,
            };
            leave_out(stream, "mailbox_full", full);
        }
    }

    /// Lets an estimate give way to a check with which it cannot be right.
    pub(super) fn give_way(&self, document: &mut EstimateDocument) {
        if let Some(finding) = self.robot.checks().spoiling() {
            document::give_way(document, finding);
        }
    }

    /// Updates the warnings about the robot's messages.
    pub(super) fn warn(&self) {
        let estimate = self.robot.estimate();
        let mut warnings = Vec::new();
        if self.intake.looks_commanded(estimate.as_deref()) {
            warnings.push(Warning::steering_looks_commanded());
        }
        if self.senders.are_two() {
            warnings.push(Warning::two_senders());
        }
        let coarse = self.intake.coarsely_stamped();
        if !coarse.is_empty() {
            warnings.push(Warning::stamps_coarse(&coarse));
        }
        warnings.extend(Warning::stamped_on_arrival(self.intake.unstamped()));
        if self.intake.steers_by_turn() {
            warnings.push(Warning::steering_from_yaw_rate());
        }
        if let Engine::Running(calibrator) = &self.engine {
            let scanner = calibrator.scanner();
            match scanner.beam_times {
                BeamTimes::Turning { .. } => warnings.push(Warning::scan_beam_times_missing()),
                BeamTimes::Missing => warnings.push(Warning::point_times_missing()),
                BeamTimes::Stated | BeamTimes::Unknown | BeamTimes::AtOnce => {}
            }
            if let Some(floor) = scanner.floor {
                let (distance_m, direction_rad) = (floor.distance_m(), floor.direction_rad());
                warnings.push(Warning::scanner_sees_floor(distance_m, direction_rad));
            }
        }
        let checks = self.robot.checks();
        warnings.extend(Warning::joining_check(&checks));
        warnings.extend(Warning::messages_left_out(&checks));
        let kinds: Vec<_> = warnings.iter().map(|warning| warning.kind).collect();
        if self.robot.set_warnings(warnings) && !kinds.is_empty() {
            tracing::warn!(robot.id = %self.robot.id, ?kinds, "what the robot sends looks wrong");
        }
    }
}
