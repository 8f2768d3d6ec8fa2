//! One robot in real time.

use std::collections::VecDeque;
use std::num::NonZeroU32;
use std::time::Duration;

use fleetcal_model::{Generation, RobotTime};
use fleetcal_proto::event::CrossTrackError;
use fleetcal_proto::ros::{DriveSamples, StringMessage};
use fleetcal_proto::signing::TrustedKeys;
use fleetcal_proto::{Keys, RobotId, RosMessage, StreamKind};
use tokio::sync::{mpsc, watch};
use tokio::time::{Instant, MissedTickBehavior, interval};
use tokio_util::sync::CancellationToken;
use tracing::{debug, warn};

use super::calibration::{agent, applied_of};
use super::description;
use super::message::{
    DriveBatch, DriveRefused, StampRefused, drive_message, lidar_pose_message, scan_message,
};
use super::robots::SimulatedRobot;
use super::session::RobotSession;
use super::{DriveMessages, FleetError, RobotSummary};
use crate::agent::{Activation, Agent, Effect, Event, HookAnswer, Outcome, PULL_PERIOD, follow};
use crate::session::ClientConfig;
use crate::simulator::{DriveSample, Emitted, SimulatedMessage, Simulation};

/// Interval at which a robot checks for due messages: that of the wheel odometry.
const TICK: Duration = Duration::from_millis(10);
/// Interval at which its agent checks its deadlines.
const AGENT_TICK: Duration = Duration::from_millis(200);
/// Interval at which a robot publishes its description: a service that starts later receives it too.
const DESCRIPTION_PERIOD: Duration = Duration::from_secs(10);
/// Age beyond which messages are left out: a robot does not replay its past.
const LATE_MAX: Duration = Duration::from_secs(2);

/// Real time and message time of the fleet's start.
#[derive(Debug, Clone, Copy)]
pub(super) struct Epoch {
    pub instant: Instant,
    pub stamp_ns: i64,
    /// Seconds of message time in one of real time.
    pub rate: NonZeroU32,
}

impl Epoch {
    fn now(&self) -> RobotTime {
        RobotTime(self.stamp_ns).plus(self.instant.elapsed() * self.rate.get())
    }
}

/// Course of a robot's run, as of all robots of the fleet.
#[derive(Debug, Clone)]
pub(super) struct Course {
    /// Messages of its drive samples.
    pub drive_messages: DriveMessages,
    /// Its time.
    pub epoch: Epoch,
    /// Signal of the end.
    pub stop: CancellationToken,
}

/// Runs a robot until it is stopped.
pub(super) async fn run(
    mut robot: SimulatedRobot,
    client: &ClientConfig,
    keys: &Keys,
    trusted: Option<&TrustedKeys>,
    course: Course,
) -> Result<RobotSummary, FleetError> {
    let Course {
        drive_messages,
        epoch,
        stop,
    } = course;
    let id = robot.id.clone();
    let data = description::urdf(&robot);
    let trusted_now = trusted.map(|trusted| watch::Sender::new(trusted.clone()));
    let followed = trusted_now.as_ref().map(watch::Sender::subscribe);
    let opened = RobotSession::open(client, keys, &id, followed, drive_messages, &stop).await?;
    robot.config.start_stamp_ns = epoch.now().0;
    let agent = trusted.map(|trusted| {
        let nominal = robot.config.applied;
        agent(id.clone(), trusted.clone(), nominal, epoch.now())
    });
    let mut simulation = Simulation::new(robot.config).map_err(|reason| FleetError::Setting {
        robot: id.clone(),
        reason,
    })?;
    let summary = RobotSummary {
        id,
        drive_samples: 0,
        scans: 0,
        late: 0,
        generation: Generation::FACTORY,
    };
    let Some((session, incoming)) = opened else {
        return Ok(summary);
    };
    let next = simulation.advance();
    let mut driver = Driver {
        simulation,
        next,
        agent,
        trusted_now,
        session,
        drive_messages,
        batch: DriveBatch::default(),
        description: StringMessage { data }.to_cdr(),
        epoch,
        summary,
    };
    let ended = driver.drive(incoming, &stop).await;
    let ended = match ended {
        Ok(()) => driver.send_batch().await,
        failed => failed,
    };
    driver.session.close().await;
    ended.map(|()| driver.summary)
}

/// A robot in motion.
struct Driver {
    simulation: Simulation,
    next: Emitted,
    /// Agent, taken out while it is at work; `None` for a robot without trusted keys.
    agent: Option<Agent>,
    /// Keys that the agent trusts, for the link.
    trusted_now: Option<watch::Sender<TrustedKeys>>,
    session: RobotSession,
    drive_messages: DriveMessages,
    /// Drive samples that wait for their message to be full, or for the next scan.
    batch: DriveBatch,
    /// Its description, CDR.
    description: Vec<u8>,
    epoch: Epoch,
    summary: RobotSummary,
}

impl Driver {
    async fn drive(
        &mut self,
        mut incoming: mpsc::Receiver<Event>,
        stop: &CancellationToken,
    ) -> Result<(), FleetError> {
        let mut tick = interval(TICK);
        tick.set_missed_tick_behavior(MissedTickBehavior::Skip);
        let mut pull = interval(PULL_PERIOD);
        pull.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut agent_tick = interval(AGENT_TICK);
        agent_tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut describing = interval(DESCRIPTION_PERIOD);
        describing.set_missed_tick_behavior(MissedTickBehavior::Delay);
        self.calibrate(Event::Restarted { written: false }).await?;
        loop {
            tokio::select! {
                biased;
                () = stop.cancelled() => return Ok(()),
                Some(event) = incoming.recv() => {
                    let is_service = event == Event::ServiceUp;
                    self.calibrate(event).await?;
                    if is_service {
                        self.pull().await?;
                    }
                }
                _ = pull.tick() => self.pull().await?,
                _ = agent_tick.tick() => self.calibrate(Event::Tick).await?,
                _ = describing.tick() => self.describe().await?,
                _ = tick.tick() => self.send_due().await?,
            }
        }
    }

    async fn describe(&self) -> Result<(), FleetError> {
        let description = self.description.clone();
        Ok(self
            .session
            .send(StreamKind::RobotDescription, description)
            .await?)
    }

    /// Sends all messages that are due by now.
    async fn send_due(&mut self) -> Result<(), FleetError> {
        let now_ns = self.epoch.now().0;
        if now_ns - self.next.sent_ns > LATE_MAX.as_nanos() as i64 {
            self.leave_out(now_ns);
        }
        while self.next.sent_ns <= now_ns {
            let next = self.simulation.advance();
            let due = std::mem::replace(&mut self.next, next);
            self.send(due.message).await?;
        }
        Ok(())
    }

    /// Leaves out all messages until `now_ns`. Beams that nobody waits for would keep the robot late
    /// for good where computing time is short.
    fn leave_out(&mut self, now_ns: i64) {
        if self.summary.late == 0 {
            warn!(robot.id = %self.summary.id, "too slow for real time: messages are left out");
        }
        self.summary.late += 1 + self.simulation.pass(now_ns);
        self.next = self.simulation.advance();
    }

    async fn send(&mut self, message: SimulatedMessage) -> Result<(), FleetError> {
        if !matches!(message, SimulatedMessage::WheelOdometry(_)) {
            self.send_batch().await?;
        }
        let id = &self.summary.id;
        let (kind, payload) = match message {
            SimulatedMessage::WheelOdometry(drive) => return self.send_drive(&drive).await,
            SimulatedMessage::Scan(scan) => {
                self.summary.scans += 1;
                (
                    StreamKind::Scan,
                    scan_message(scan).map_err(at(id))?.to_cdr(),
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
                let (stamp_ns, value_m) = (RobotTime(error.stamp_ns), error.value_m);
                let json = json(&CrossTrackError { stamp_ns, value_m });
                (StreamKind::CrossTrackError, json)
            }
        };
        Ok(self.session.send(kind, payload).await?)
    }

    /// Sends a drive sample, or keeps it for the next message.
    async fn send_drive(&mut self, drive: &DriveSample) -> Result<(), FleetError> {
        let id = &self.summary.id;
        match self.drive_messages {
            DriveMessages::Single => {
                let payload = drive_message(drive).map_err(at(id))?.to_cdr();
                self.summary.drive_samples += 1;
                Ok(self
                    .session
                    .send(StreamKind::WheelOdometry, payload)
                    .await?)
            }
            DriveMessages::Several => {
                let full = self.batch.add(drive).map_err(of_drive(id))?;
                self.send_samples(full).await
            }
        }
    }

    /// Sends the drive samples that wait for their message to be full.
    async fn send_batch(&mut self) -> Result<(), FleetError> {
        let waiting = self.batch.take().map_err(of_drive(&self.summary.id))?;
        self.send_samples(waiting).await
    }

    async fn send_samples(&mut self, message: Option<DriveSamples>) -> Result<(), FleetError> {
        let Some(message) = message else {
            return Ok(());
        };
        self.summary.drive_samples += message.samples().len() as u64;
        let payload = message.to_cdr();
        Ok(self
            .session
            .send(StreamKind::WheelOdometry, payload)
            .await?)
    }

    /// Passes an event to the robot's agent and performs its decisions.
    async fn calibrate(&mut self, event: Event) -> Result<(), FleetError> {
        let Some(mut agent) = self.agent.take() else {
            return Ok(());
        };
        let mut events = VecDeque::from([event]);
        while let Some(event) = events.pop_front() {
            let effects = agent.step(event, self.epoch.now())?;
            if let Some(trusted) = &self.trusted_now {
                follow(trusted, &agent);
            }
            for effect in effects {
                events.extend(self.perform(effect).await?);
            }
        }
        self.summary.generation = agent.memory().held.generation;
        self.agent = Some(agent);
        Ok(())
    }

    /// Performs an effect. A simulated robot applies at once, in motion: it never stands still, and
    /// its steering uses a new zero from one command to the next.
    async fn perform(&mut self, effect: Effect) -> Result<Option<Event>, FleetError> {
        let robot = &self.summary.id;
        match effect {
            Effect::AskHook(_) => {
                return Ok(Some(Event::HookAnswered(HookAnswer::Go { before: None })));
            }
            Effect::Write(values) => {
                self.simulation.set_applied(applied_of(&values));
                return Ok(Some(Event::Written(Ok(()))));
            }
            Effect::Activate(_) => return Ok(Some(Event::Activated(Activation::Done))),
            Effect::Restore(fallback) => {
                if let Some(values) = fallback.held.values {
                    self.simulation.set_applied(applied_of(&values));
                }
                return Ok(Some(Event::Restored(Ok(()))));
            }
            Effect::TellReverted(ending) => {
                if let Outcome::Answered { reason, .. } = ending.outcome {
                    let generation = ending.generation;
                    warn!(robot.id = %robot, %generation, reason, "back to the former calibration");
                }
                return Ok(Some(Event::RevertTold(Ok(()))));
            }
            Effect::Acknowledge(answer) => {
                let (generation, status) = (answer.generation, answer.status);
                let reason = answer.reason.as_deref().unwrap_or_default();
                debug!(robot.id = %robot, %generation, ?status, reason, "answers a calibration");
                self.session.calibration.acknowledge(&answer).await?;
            }
            Effect::AskConfirmed => self.session.calibration.ask_confirmed().await?,
            Effect::Pull => self.ask().await?,
            Effect::Note(note) => debug!(robot.id = %robot, "{note}"),
        }
        Ok(None)
    }

    async fn pull(&self) -> Result<(), FleetError> {
        if self.agent.is_some() {
            self.ask().await?;
        }
        Ok(())
    }

    async fn ask(&self) -> Result<(), FleetError> {
        self.session.calibration.ask_confirmed().await?;
        self.session.calibration.ask_approved().await?;
        Ok(())
    }
}

#[expect(
    clippy::expect_used,
    reason = "structs of numbers and strings are always JSON"
)]
fn json(value: &impl serde::Serialize) -> Vec<u8> {
    serde_json::to_vec(value).expect("a plain struct is JSON")
}

fn of_drive(robot: &RobotId) -> impl FnOnce(DriveRefused) -> FleetError {
    let robot = robot.clone();
    move |reason| FleetError::Drive { robot, reason }
}

fn at(robot: &RobotId) -> impl FnOnce(StampRefused) -> FleetError {
    let robot = robot.clone();
    move |reason| FleetError::RobotTime { robot, reason }
}
