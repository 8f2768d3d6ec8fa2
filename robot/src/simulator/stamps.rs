//! Stamps as the robot's clocks give them, and messages that are lost.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::imperfections::ClockImperfections;
use super::message::SimulatedMessage;
use super::random::{Stream, stream};

/// Least time between two stamps of one stream with jitter, ns.
const LEAST_GAP_NS: i64 = 100_000;

/// Stream of a message, one of two.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Line {
    WheelOdometry,
    Lidar,
}

/// Clocks of both streams.
#[derive(Debug)]
pub(super) struct Stamps {
    imperfections: ClockImperfections,
    jitter: ChaCha8Rng,
    losses: ChaCha8Rng,
    last_drive_ns: i64,
    last_lidar_ns: i64,
}

impl Stamps {
    pub fn new(imperfections: ClockImperfections, seed: u64) -> Self {
        Self {
            imperfections,
            jitter: stream(seed, Stream::Jitter),
            losses: stream(seed, Stream::Losses),
            last_drive_ns: i64::MIN,
            last_lidar_ns: i64::MIN,
        }
    }

    /// Stamps a message, still counted from the start; `None` if it is lost. The robot's
    /// cross-track error has its own way and always arrives.
    pub fn send(&mut self, mut message: SimulatedMessage) -> Option<SimulatedMessage> {
        let (line, stamp_ns) = match &mut message {
            SimulatedMessage::WheelOdometry(drive) => (Line::WheelOdometry, &mut drive.stamp_ns),
            SimulatedMessage::Scan(scan) => (Line::Lidar, &mut scan.stamp_ns),
            SimulatedMessage::LidarPose(pose) => (Line::Lidar, &mut pose.stamp_ns),
            SimulatedMessage::CrossTrackError(_) => return Some(message),
        };
        *stamp_ns = self.stamp_ns(line, *stamp_ns);
        let share = self.imperfections.lost_messages;
        let lost = share > 0.0 && self.losses.random::<f64>() < share;
        (!lost).then_some(message)
    }

    /// 1. The wheel odometry's clock runs at its own rate: `t·(1 + drift)`.
    /// 2. Every stamp trembles; a stream is first in, first out, so its stamps rise.
    fn stamp_ns(&mut self, line: Line, time_ns: i64) -> i64 {
        let mut stamp_ns = time_ns;
        if line == Line::WheelOdometry {
            stamp_ns += (self.imperfections.drive_drift * time_ns as f64).round() as i64;
        }
        let sigma_ns = self.imperfections.stamp_jitter_s * 1e9;
        if sigma_ns > 0.0 {
            let noise: f64 = StandardNormal.sample(&mut self.jitter);
            let last_ns = match line {
                Line::WheelOdometry => &mut self.last_drive_ns,
                Line::Lidar => &mut self.last_lidar_ns,
            };
            stamp_ns += (sigma_ns * noise).round() as i64;
            stamp_ns = stamp_ns.max(last_ns.saturating_add(LEAST_GAP_NS));
            *last_ns = stamp_ns;
        }
        stamp_ns
    }
}
