//! The simulation itself: one robot, step by step.

use std::collections::VecDeque;

use super::check::SettingRefused;
use super::config::{Applied, Change, LidarOutput, SimulationConfig};
use super::controller::Controller;
use super::drive_sensor::DriveSensor;
use super::lidar::{Lidar, LidarSettings};
use super::message::{CrossTrackError, Emitted, SimulatedMessage, TrueParameters, Truth};
use super::people::Crowd;
use super::plane::Pose2;
use super::pose_sensor::PoseSensor;
use super::stamps::Stamps;
use super::steering_curve::SteeringCurve;
use super::track::{Moment, Track};
use super::vehicle::{Command, Motion};

/// Step of the integration, ns.
const STEP_NS: i64 = 1_000_000;
const STEP_S: f64 = STEP_NS as f64 * 1e-9;
/// Time from one command of the controller to the next, ns.
const CONTROL_NS: i64 = 20_000_000;
/// Time from one cross-track error to the next, ns.
const CROSS_TRACK_ERROR_NS: i64 = 1_000_000_000;

/// Source of the LiDAR's messages, with the time of the next one.
#[derive(Debug)]
enum LidarSource {
    Scans {
        lidar: Box<Lidar>,
        settings: LidarSettings,
        next_ns: i64,
    },
    Poses {
        sensor: Box<PoseSensor>,
        period_ns: i64,
        next_ns: i64,
    },
}

impl LidarSource {
    /// Leaves out all messages that are due at a time from the start; returns their number.
    fn skip(&mut self, now_ns: i64) -> u64 {
        let (next_ns, period_ns, duration_ns) = match self {
            Self::Scans {
                settings, next_ns, ..
            } => (next_ns, settings.period_ns(), settings.duration_ns()),
            Self::Poses {
                period_ns, next_ns, ..
            } => (next_ns, *period_ns, 0),
        };
        let mut skipped = 0;
        while *next_ns + duration_ns <= now_ns {
            *next_ns += period_ns;
            skipped += 1;
        }
        skipped
    }
}

/// One simulated robot. [`Simulation::advance`] never ends.
#[derive(Debug)]
pub struct Simulation {
    config: SimulationConfig,
    now_ns: i64,
    motion: Motion,
    track: Track,
    controller: Controller,
    command: Command,
    steering_drift_rad_per_s: f64,
    yaw_drift_rad_per_s: f64,
    drive_sensor: DriveSensor,
    stamps: Stamps,
    lidar: LidarSource,
    crowd: Crowd,
    drive_period_ns: i64,
    ready: VecDeque<Emitted>,
}

impl Simulation {
    /// Makes a simulation at its start.
    ///
    /// # Errors
    /// Names the impossible setting.
    pub fn new(config: SimulationConfig) -> Result<Self, SettingRefused> {
        config.check()?;
        let mut config = config.with_imperfect_settings();
        config.changes.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
        let vehicle = &config.vehicle;
        let start = config.route.start();
        let moment = Moment {
            base: start,
            lidar: start.compose(&vehicle.lidar_in_base),
            ..Moment::default()
        };
        let (lidar, memory_ns) = lidar_source(&config);
        Ok(Self {
            now_ns: 0,
            motion: Motion::new(start, config.seed),
            track: Track::new(0, STEP_NS, memory_ns, moment),
            controller: Controller::new(&config),
            command: Command::default(),
            steering_drift_rad_per_s: 0.0,
            yaw_drift_rad_per_s: 0.0,
            drive_sensor: DriveSensor::new(config.drive, delay_steps(&config), config.seed),
            stamps: Stamps::new(config.imperfections.clocks, config.seed),
            lidar,
            crowd: Crowd::new(config.people, config.seed, config.world.walkable()),
            drive_period_ns: whole_steps(1e9 / config.drive.rate_hz),
            ready: VecDeque::new(),
            config,
        })
    }

    /// Returns the next message, in the order of sending. A scan carries the stamp of its first
    /// beam but is sent after its last one.
    pub fn advance(&mut self) -> Emitted {
        loop {
            if let Some(emitted) = self.ready.pop_front() {
                return emitted;
            }
            self.step();
        }
    }

    /// Drives on to a stamp without casting a beam, and returns the number of messages that are left
    /// out: many times faster than [`Self::advance`].
    pub fn pass(&mut self, until_ns: i64) -> u64 {
        let mut left_out = 0;
        while self.stamp_ns() < until_ns {
            self.drive();
            left_out += self.lidar.skip(self.now_ns);
            self.sense_drive();
            left_out += self.ready.drain(..).count() as u64;
        }
        left_out
    }

    /// Returns all messages of the next `duration_s`, ordered by their stamps.
    pub fn run(&mut self, duration_s: f64) -> Vec<Emitted> {
        let end_ns = self.stamp_ns() + (duration_s * 1e9) as i64;
        let mut messages = Vec::new();
        while self.stamp_ns() < end_ns {
            self.step();
            messages.extend(self.ready.drain(..));
        }
        messages.sort_by_key(|emitted| emitted.message.stamp_ns());
        messages
    }

    /// Sets the calibration that the robot drives with from now on.
    pub fn set_applied(&mut self, applied: Applied) {
        self.config.applied = applied;
    }

    /// Returns the calibration that the robot drives with.
    pub fn applied(&self) -> Applied {
        self.config.applied
    }

    /// Returns the present parameters.
    pub fn parameters(&self) -> TrueParameters {
        let (vehicle, imperfections) = (&self.config.vehicle, &self.config.imperfections);
        let drifted_s = imperfections.clocks.drive_drift * self.now_ns as f64 * 1e-9;
        TrueParameters {
            steering_gain: SteeringCurve::new(vehicle.steering_gain, &imperfections.vehicle).gain(),
            time_offset_s: vehicle.time_offset_s + drifted_s,
            ..vehicle.parameters()
        }
    }

    /// Returns the configuration, with the vehicle's present state.
    pub fn config(&self) -> &SimulationConfig {
        &self.config
    }

    /// Returns the present moment in message time, ns.
    pub fn stamp_ns(&self) -> i64 {
        self.config.start_stamp_ns + self.now_ns
    }

    fn step(&mut self) {
        self.drive();
        self.sense_lidar();
        self.sense_drive();
        if self.now_ns % CROSS_TRACK_ERROR_NS == 0 {
            let value_m = self.controller.believed_left_m();
            let error = CrossTrackError {
                stamp_ns: self.now_ns,
                value_m,
            };
            self.emit(
                SimulatedMessage::CrossTrackError(error),
                self.now_ns,
                self.now_ns,
            );
        }
    }

    /// Moves the vehicle on by a step.
    fn drive(&mut self) {
        self.change_vehicle();
        if self.now_ns % CONTROL_NS == 0 {
            self.control();
        }
        self.now_ns += STEP_NS;
        let (vehicle, imperfections) = (&self.config.vehicle, &self.config.imperfections.vehicle);
        self.motion
            .advance(vehicle, imperfections, &self.command, STEP_S);
        self.drive_sensor
            .gather(vehicle, imperfections, &self.motion);
        self.track.push(Moment {
            base: self.motion.base,
            lidar: self.motion.base.compose(&self.config.vehicle.lidar_in_base),
            speed_mps: self.motion.speed_mps,
            steering_rad: self.motion.steering_rad,
        });
    }

    fn control(&mut self) {
        let lidar = self.motion.base.compose(&self.config.vehicle.lidar_in_base);
        self.command = self.controller.command(
            &self.motion.base,
            &lidar,
            &self.config.applied,
            self.now_ns as f64 * 1e-9,
            CONTROL_NS as f64 * 1e-9,
        );
    }

    fn change_vehicle(&mut self) {
        let now_s = self.now_ns as f64 * 1e-9;
        while self
            .config
            .changes
            .first()
            .is_some_and(|next| next.at_s <= now_s)
        {
            let due = self.config.changes.remove(0);
            self.apply(due.change);
        }
        self.config.vehicle.steering_offset_rad += self.steering_drift_rad_per_s * STEP_S;
        self.config.vehicle.lidar_in_base.yaw_rad += self.yaw_drift_rad_per_s * STEP_S;
    }

    fn apply(&mut self, change: Change) {
        let vehicle = &mut self.config.vehicle;
        match change {
            Change::SteeringOffset(by_rad) => vehicle.steering_offset_rad += by_rad,
            Change::Mount(by) => {
                let mount = vehicle.lidar_in_base;
                vehicle.lidar_in_base = Pose2::new(
                    mount.x_m + by.x_m,
                    mount.y_m + by.y_m,
                    mount.yaw_rad + by.yaw_rad,
                );
            }
            Change::SteeringDrift(rad_per_s) => self.steering_drift_rad_per_s = rad_per_s,
            Change::MountYawDrift(rad_per_s) => self.yaw_drift_rad_per_s = rad_per_s,
        }
    }

    fn sense_drive(&mut self) {
        if self.now_ns % self.drive_period_ns == 0 {
            let drive = self.drive_sensor.sample(&self.config.vehicle, self.now_ns);
            self.emit(
                SimulatedMessage::WheelOdometry(drive),
                self.now_ns,
                self.now_ns,
            );
        }
    }

    fn sense_lidar(&mut self) {
        let (message, reference_ns, sent_ns) = match &mut self.lidar {
            LidarSource::Scans {
                lidar,
                settings,
                next_ns,
            } => {
                let (start_ns, sent_ns) = (*next_ns, *next_ns + settings.duration_ns());
                if sent_ns > self.now_ns {
                    return;
                }
                *next_ns += settings.period_ns();
                let scan = lidar.scan(&self.config.world, &mut self.crowd, &self.track, start_ns);
                (
                    SimulatedMessage::Scan(scan),
                    start_ns + settings.reference_ns(),
                    sent_ns,
                )
            }
            LidarSource::Poses {
                sensor,
                period_ns,
                next_ns,
            } => {
                let time_ns = *next_ns;
                if time_ns > self.now_ns {
                    return;
                }
                *next_ns += *period_ns;
                let pose = sensor.pose(self.track.at(time_ns).lidar, time_ns);
                (SimulatedMessage::LidarPose(pose), time_ns, time_ns)
            }
        };
        self.emit(message, reference_ns, sent_ns);
    }

    /// Adds a message, whose stamp still counts from the start, to those that are ready.
    fn emit(&mut self, message: SimulatedMessage, reference_ns: i64, sent_ns: i64) {
        let start_ns = self.config.start_stamp_ns;
        let Some(message) = self.stamps.send(message) else {
            return;
        };
        self.ready.push_back(Emitted {
            sent_ns: start_ns + sent_ns,
            message: stamped(message, start_ns),
            truth: self.truth(reference_ns),
            truth_when_sent: self.truth(sent_ns),
        });
    }

    fn truth(&self, time_ns: i64) -> Truth {
        let moment = self.track.at(time_ns);
        Truth {
            stamp_ns: self.config.start_stamp_ns + time_ns,
            base: moment.base,
            lidar: moment.lidar,
            speed_mps: moment.speed_mps,
            steering_rad: moment.steering_rad,
            cross_track_error_m: self.controller.true_left_m(),
        }
    }
}

/// Makes the LiDAR's source; returns it with the length of track that it needs, ns.
fn lidar_source(config: &SimulationConfig) -> (LidarSource, i64) {
    match config.lidar {
        LidarOutput::Scans(settings) => {
            let imperfections = &config.imperfections;
            let lidar = Box::new(Lidar::new(
                settings,
                imperfections.scanner,
                imperfections.lidar.range_scale,
                config.seed,
            ));
            let next_ns = (settings.phase_s * 1e9) as i64;
            let memory_ns = settings.duration_ns() + 2 * STEP_NS;
            (
                LidarSource::Scans {
                    lidar,
                    settings,
                    next_ns,
                },
                memory_ns,
            )
        }
        LidarOutput::Poses(settings) => {
            let range_scale = config.imperfections.lidar.range_scale;
            let sensor = Box::new(PoseSensor::new(settings, range_scale, config.seed));
            let next_ns = (settings.phase_s * 1e9) as i64;
            let period_ns = (1e9 / settings.rate_hz).round() as i64;
            (
                LidarSource::Poses {
                    sensor,
                    period_ns,
                    next_ns,
                },
                2 * STEP_NS,
            )
        }
    }
}

/// Returns the delay of the steering sensor, in steps of the motion.
fn delay_steps(config: &SimulationConfig) -> usize {
    (config.imperfections.vehicle.steering_delay_s / STEP_S).round() as usize
}

/// Rounds a duration to whole steps, at least one, ns.
fn whole_steps(duration_ns: f64) -> i64 {
    ((duration_ns / STEP_NS as f64).round() as i64).max(1) * STEP_NS
}

/// Converts the message's stamp to count from 1970 instead of from the start.
fn stamped(mut message: SimulatedMessage, start_ns: i64) -> SimulatedMessage {
    match &mut message {
        SimulatedMessage::WheelOdometry(drive) => drive.stamp_ns += start_ns,
        SimulatedMessage::Scan(scan) => scan.stamp_ns += start_ns,
        SimulatedMessage::LidarPose(pose) => pose.stamp_ns += start_ns,
        SimulatedMessage::CrossTrackError(error) => error.stamp_ns += start_ns,
    }
    message
}
