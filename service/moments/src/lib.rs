//! Moments: the latest data of a robot, written to disk when something happens to it.
//!
//! Each robot's latest messages are in memory, in `fleetcal-fleet`. When a change, a fault, a failed
//! verification or a reassembly is announced, or somebody asks for it, they become a file of the data
//! folder that `calibrate` and readers of ROS recordings open. One thread writes, apart from the
//! robots' tasks.

mod disk;
mod trigger;

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use fleetcal_clock::SharedClock;
use fleetcal_domain::{limits, timestamp};
use fleetcal_fleet::{FleetHandle, FleetRefused, Held};
use fleetcal_model::RobotId;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use thiserror::Error;
use tokio::sync::{mpsc, oneshot};
use utoipa::ToSchema;

use disk::Shelf;
use trigger::Triggers;

/// Name of the folder of the moments in the data folder.
const FOLDER: &str = "moments";

/// Reason for a moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum MomentKind {
    /// The estimator detected a change of the vehicle.
    Change,
    /// A sensor, the LiDAR odometry or the estimator failed, or a joining check named a cause.
    Fault,
    /// A verification run disagreed with the calibration in use.
    VerificationFailed,
    /// Somebody reported a reassembly.
    Reassembled,
    /// Somebody asked for the moment.
    Requested,
}

/// Latest data of a robot, kept when something happened to it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Moment {
    /// Number of the moment, which grows with each one of the robot.
    pub id: i64,
    /// Id of the robot.
    #[schema(value_type = String)]
    pub robot: RobotId,
    /// Time at which it was kept.
    #[schema(value_type = String, format = DateTime)]
    pub kept_at: Timestamp,
    /// Reason for it.
    pub kind: MomentKind,
    /// Reason in words; may be empty.
    pub note: String,
    /// Stamp of the oldest message, by the robot's clock.
    #[schema(value_type = String, format = DateTime)]
    pub from: Timestamp,
    /// Stamp of the newest message, by the robot's clock.
    #[schema(value_type = String, format = DateTime)]
    pub to: Timestamp,
    /// Number of messages of the robot.
    pub messages: u64,
    /// Size of the file, bytes.
    pub bytes: u64,
}

/// Counts since the service started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MomentCounts {
    /// Moments that were written.
    pub kept: u64,
    /// Moments that were dropped for newer ones.
    pub dropped: u64,
    /// Moments that were not written: too many waited, or the disk failed.
    pub lost: u64,
}

/// Reason for which no moment was kept.
#[derive(Debug, Error)]
pub enum MomentRefused {
    /// The robot is unknown.
    #[error(transparent)]
    Robot(#[from] FleetRefused),
    /// The robot has sent nothing in the last minute.
    #[error("robot {0} has sent nothing within the last {seconds} s", seconds = limits::MOMENT_SPAN.as_secs())]
    NoData(RobotId),
    /// Others wait for the disk.
    #[error("{} moments wait for the disk already", limits::MOMENTS_WAITING_MAX)]
    Full,
    /// It could not be written.
    #[error("the moment could not be written: {0}")]
    Disk(io::Error),
}

/// Moment that waits to be written.
#[derive(Debug)]
struct Wanted {
    robot: RobotId,
    kind: MomentKind,
    words: String,
    held: Held,
    answer: Option<oneshot::Sender<io::Result<Moment>>>,
}

#[derive(Debug, Default)]
struct Counts {
    kept: AtomicU64,
    dropped: AtomicU64,
    lost: AtomicU64,
}

#[derive(Debug)]
struct Inner {
    fleet: FleetHandle,
    clock: SharedClock,
    wanted: mpsc::Sender<Wanted>,
    shelf: Mutex<Shelf>,
    counts: Counts,
}

/// Moments of all robots of this process; cheap to clone.
#[derive(Debug, Clone)]
pub struct Moments {
    inner: Arc<Inner>,
}

impl Moments {
    /// Reads the moments of a data folder and begins to keep further ones, until the fleet ends.
    ///
    /// # Errors
    /// The folder cannot be made or read.
    pub fn start(data: &Path, fleet: FleetHandle, clock: SharedClock) -> io::Result<Self> {
        let (wanted, waiting) = mpsc::channel(limits::MOMENTS_WAITING_MAX);
        let shelf = Shelf::read(data.join(FOLDER))?;
        let live = fleet.live();
        let inner = Arc::new(Inner {
            fleet,
            clock,
            wanted,
            shelf: Mutex::new(shelf),
            counts: Counts::default(),
        });
        let moments = Self { inner };
        tokio::spawn(moments.clone().follow(live));
        tokio::spawn(moments.clone().write_all(waiting));
        Ok(moments)
    }

    /// Returns a robot's moments, the newest first.
    pub fn of(&self, robot: &RobotId) -> Vec<Moment> {
        self.shelf().of(robot)
    }

    /// Returns a moment of a robot and the path of its file.
    pub fn find(&self, robot: &RobotId, id: i64) -> Option<(Moment, PathBuf)> {
        let shelf = self.shelf();
        let moment = shelf.of(robot).into_iter().find(|moment| moment.id == id)?;
        let path = shelf.file(robot, id);
        Some((moment, path))
    }

    /// Returns the counts since the service started.
    pub fn counts(&self) -> MomentCounts {
        let of = |count: &AtomicU64| count.load(Ordering::Relaxed);
        let counts = &self.inner.counts;
        MomentCounts {
            kept: of(&counts.kept),
            dropped: of(&counts.dropped),
            lost: of(&counts.lost),
        }
    }

    /// Keeps the robot's latest data. On return they are on disk.
    ///
    /// # Errors
    /// See [`MomentRefused`].
    pub async fn keep(&self, robot: &RobotId, words: String) -> Result<Moment, MomentRefused> {
        let held = self.inner.fleet.latest_data(robot)?;
        if held.is_empty() {
            return Err(MomentRefused::NoData(robot.clone()));
        }
        let (answer, written) = oneshot::channel();
        let wanted = Wanted {
            robot: robot.clone(),
            kind: MomentKind::Requested,
            words,
            held,
            answer: Some(answer),
        };
        let sent = self.inner.wanted.try_send(wanted);
        sent.map_err(|_| MomentRefused::Full)?;
        let written = written.await.map_err(io::Error::other);
        written.flatten().map_err(MomentRefused::Disk)
    }

    /// Keeps the data of the robots to which something happens.
    async fn follow(
        self,
        mut live: tokio::sync::broadcast::Receiver<fleetcal_fleet::live::LiveUpdate>,
    ) {
        use tokio::sync::broadcast::error::RecvError;
        let mut triggers = Triggers::default();
        loop {
            let update = match live.recv().await {
                Ok(update) => update,
                Err(RecvError::Lagged(lost)) => {
                    tracing::warn!(lost, "moments missed live updates");
                    continue;
                }
                Err(RecvError::Closed) => return,
            };
            let clock = &self.inner.clock;
            let taken = triggers.take(&update, clock.elapsed(), clock.now());
            let Some((robot, kind, words)) = taken else {
                continue;
            };
            let held = self.inner.fleet.latest_data(&robot).unwrap_or_default();
            // Another instance has the robot, or it sends nothing.
            if held.is_empty() {
                continue;
            }
            let wanted = Wanted {
                robot,
                kind,
                words,
                held,
                answer: None,
            };
            if let Err(error) = self.inner.wanted.try_send(wanted) {
                self.inner.counts.lost.fetch_add(1, Ordering::Relaxed);
                tracing::warn!(%error, "a moment is lost");
            }
        }
    }

    /// Writes what waits, one at a time.
    async fn write_all(self, mut waiting: mpsc::Receiver<Wanted>) {
        while let Some(wanted) = waiting.recv().await {
            let moments = self.clone();
            let written = tokio::task::spawn_blocking(move || moments.write(wanted));
            if let Err(error) = written.await {
                tracing::error!(%error, "the writer of moments failed");
            }
        }
    }

    fn write(&self, wanted: Wanted) {
        let Wanted {
            robot,
            kind,
            words,
            held,
            answer,
        } = wanted;
        let counts = &self.inner.counts;
        let now = self.inner.clock.now();
        let id = self.shelf().next_id(&robot, now);
        let folder = self.shelf().folder(&robot);
        let written = disk::write(
            &folder,
            Moment {
                id,
                robot,
                kept_at: timestamp::of(now),
                kind,
                note: words,
                from: Timestamp::UNIX_EPOCH,
                to: Timestamp::UNIX_EPOCH,
                messages: 0,
                bytes: 0,
            },
            &held,
        );
        match &written {
            Ok(moment) => {
                counts.kept.fetch_add(1, Ordering::Relaxed);
                let dropped = self.shelf().add(moment.clone());
                counts.dropped.fetch_add(dropped, Ordering::Relaxed);
            }
            Err(error) => {
                counts.lost.fetch_add(1, Ordering::Relaxed);
                tracing::error!(%error, "a moment could not be written");
            }
        }
        if let Some(answer) = answer {
            // Whoever asked may have gone.
            drop(answer.send(written));
        }
    }

    /// Locks the list. It is whole after every statement, so the panic of another thread is no
    /// reason to stop.
    fn shelf(&self) -> MutexGuard<'_, Shelf> {
        self.inner
            .shelf
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }
}

/// Moments by robot, the oldest first.
type ByRobot = BTreeMap<RobotId, Vec<Moment>>;
