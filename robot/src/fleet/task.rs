//! One robot in real time.

use std::time::Duration;

use fleetcal_proto::calibration::{Applied as Acknowledgement, AppliedStatus};
use fleetcal_proto::event::CrossTrackError;
use fleetcal_proto::{Keys, RobotId, RosMessage, StreamKind};
use tokio::sync::mpsc;
use tokio::time::{Instant, MissedTickBehavior, interval};
use tokio_util::sync::CancellationToken;
use tracing::{debug, info, warn};

use super::calibration::{Held, Offered};
use super::message::{StampRefused, drive_message, lidar_pose_message, scan_message};
use super::robots::SimulatedRobot;
use super::session::{ClientConfig, Incoming, RobotSession};
use super::{FleetError, RobotSummary};
use crate::simulator::{Emitted, SimulatedMessage, Simulation};

/// How often a robot looks for what is due: the drive stream's interval.
const TICK: Duration = Duration::from_millis(10);
/// How often it asks for the approved calibration, besides when a service comes up.
const PULL_PERIOD: Duration = Duration::from_mins(1);
/// What is later than this is left out: a robot does not replay its past.
const LATE_MAX: Duration = Duration::from_secs(2);

/// Real time and message time of the fleet's start.
#[derive(Debug, Clone, Copy)]
pub(super) struct Epoch {
    pub instant: Instant,
    pub stamp_ns: i64,
}

impl Epoch {
    fn now_ns(&self) -> i64 {
        self.stamp_ns + self.instant.elapsed().as_nanos() as i64
    }
}

/// Runs a robot until it is told to stop.
pub(super) async fn run(
    mut robot: SimulatedRobot,
    client: &ClientConfig,
    keys: &Keys,
    epoch: Epoch,
    stop: CancellationToken,
) -> Result<RobotSummary, FleetError> {
    let id = robot.id.clone();
    let opened = RobotSession::open(client, keys, &id, &stop).await?;
    robot.config.start_stamp_ns = epoch.now_ns();
    let held = Held::new(id.clone(), robot.config.applied);
    let mut simulation = Simulation::new(robot.config).map_err(|reason| FleetError::Setting {
        robot: id.clone(),
        reason,
    })?;
    let summary = RobotSummary {
        id,
        drive_samples: 0,
        scans: 0,
        late: 0,
        generation: 0,
    };
    let Some((session, incoming)) = opened else {
        return Ok(summary);
    };
    let next = simulation.advance();
    let mut driver = Driver {
        simulation,
        next,
        held,
        session,
        epoch,
        summary,
    };
    let ended = driver.drive(incoming, &stop).await;
    driver.session.close().await;
    ended.map(|()| driver.summary)
}

/// A robot on its way.
struct Driver {
    simulation: Simulation,
    next: Emitted,
    held: Held,
    session: RobotSession,
    epoch: Epoch,
    summary: RobotSummary,
}

impl Driver {
    async fn drive(
        &mut self,
        mut incoming: mpsc::Receiver<Incoming>,
        stop: &CancellationToken,
    ) -> Result<(), FleetError> {
        let mut tick = interval(TICK);
        tick.set_missed_tick_behavior(MissedTickBehavior::Skip);
        let mut pull = interval(PULL_PERIOD);
        pull.set_missed_tick_behavior(MissedTickBehavior::Delay);
        self.acknowledge().await?;
        loop {
            tokio::select! {
                biased;
                () = stop.cancelled() => return Ok(()),
                Some(message) = incoming.recv() => match message {
                    Incoming::Approved(payload) => self.consider(&payload).await?,
                    Incoming::ServiceUp => {
                        self.acknowledge().await?;
                        self.session.pull().await?;
                    }
                },
                _ = pull.tick() => self.session.pull().await?,
                _ = tick.tick() => self.send_due().await?,
            }
        }
    }

    /// Sends everything that is due by now.
    async fn send_due(&mut self) -> Result<(), FleetError> {
        let now_ns = self.epoch.now_ns();
        while self.next.sent_ns <= now_ns {
            let late_ns = now_ns - self.next.sent_ns;
            let next = self.simulation.advance();
            let due = std::mem::replace(&mut self.next, next);
            if late_ns > LATE_MAX.as_nanos() as i64 {
                self.count_late();
            } else {
                self.send(due.message).await?;
            }
        }
        Ok(())
    }

    fn count_late(&mut self) {
        if self.summary.late == 0 {
            warn!(robot.id = %self.summary.id, "too slow for real time: messages are left out");
        }
        self.summary.late += 1;
    }

    async fn send(&mut self, message: SimulatedMessage) -> Result<(), FleetError> {
        let id = &self.summary.id;
        let (kind, payload) = match message {
            SimulatedMessage::Drive(drive) => {
                self.summary.drive_samples += 1;
                (
                    StreamKind::Drive,
                    drive_message(&drive).map_err(at(id))?.to_cdr(),
                )
            }
            SimulatedMessage::Sweep(sweep) => {
                self.summary.scans += 1;
                (
                    StreamKind::Scan,
                    scan_message(sweep).map_err(at(id))?.to_cdr(),
                )
            }
            SimulatedMessage::LidarPose(pose) => {
                self.summary.scans += 1;
                (
                    StreamKind::LidarOdometry,
                    lidar_pose_message(&pose).map_err(at(id))?.to_cdr(),
                )
            }
            SimulatedMessage::CrossTrackError(error) => {
                let (stamp_ns, value_m) = (error.stamp_ns, error.value_m);
                let json = json(&CrossTrackError { stamp_ns, value_m });
                (StreamKind::CrossTrackError, json)
            }
        };
        Ok(self.session.send(kind, payload).await?)
    }

    /// Applies an offered calibration and answers.
    async fn consider(&mut self, payload: &[u8]) -> Result<(), FleetError> {
        let robot = self.summary.id.clone();
        match self.held.offer(payload) {
            Offered::Taken(applied) => {
                self.simulation.set_applied(applied);
                self.summary.generation = self.held.generation();
                let generation = self.summary.generation;
                info!(robot.id = %robot, generation, "applied an approved calibration");
                self.acknowledge().await
            }
            Offered::Refused {
                generation,
                sha256,
                reason,
            } => {
                warn!(robot.id = %robot, generation, reason, "refused a calibration");
                let answer = Acknowledgement {
                    generation,
                    sha256,
                    status: AppliedStatus::Refused,
                    reason: Some(reason),
                    applied_at_ns: self.epoch.now_ns(),
                    values: None,
                };
                self.answer(&answer).await
            }
            Offered::Known => Ok(()),
            Offered::Unreadable(reason) => {
                debug!(robot.id = %robot, reason, "an offered calibration cannot be read");
                Ok(())
            }
        }
    }

    /// Says what the robot uses now.
    async fn acknowledge(&mut self) -> Result<(), FleetError> {
        let answer = self.held.acknowledgement(self.epoch.now_ns());
        self.answer(&answer).await
    }

    async fn answer(&mut self, answer: &Acknowledgement) -> Result<(), FleetError> {
        Ok(self
            .session
            .send(StreamKind::CalibrationApplied, json(answer))
            .await?)
    }
}

#[expect(
    clippy::expect_used,
    reason = "structs of numbers and strings are always JSON"
)]
fn json(value: &impl serde::Serialize) -> Vec<u8> {
    serde_json::to_vec(value).expect("a plain struct is JSON")
}

fn at(robot: &RobotId) -> impl FnOnce(StampRefused) -> FleetError {
    let robot = robot.clone();
    move |reason| FleetError::Stamp { robot, reason }
}
