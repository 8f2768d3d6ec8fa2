//! Errors of the store.

use std::path::PathBuf;
use std::sync::Arc;

use fleetcal_domain::access::AccountRefused;
use fleetcal_domain::alert::AlertRefused;
use fleetcal_domain::approval::Refused;
use fleetcal_domain::limits;
use fleetcal_domain::webhook::WebhookRefused;
use fleetcal_model::Version;
use fleetcal_proto::RobotId;
use fleetcal_rollout::RolloutRefused;
use thiserror::Error;

/// Error of a database driver, shared because a failed commit is reported to many callers.
pub type DriverError = Arc<dyn std::error::Error + Send + Sync>;

/// Reason for which a request to the store failed.
#[derive(Debug, Clone, Error)]
pub enum StoreError {
    /// Data folder that cannot be created or used.
    #[error("the data folder {path} cannot be used")]
    Folder {
        /// Path of the folder.
        path: PathBuf,
        /// Error of the system.
        #[source]
        source: Arc<std::io::Error>,
    },
    /// Data folder in use by another process.
    #[error(
        "the data folder {path} is in use by another fleetcal; stop that one or give another \
         folder with --data"
    )]
    InUse {
        /// Path of the folder.
        path: PathBuf,
    },
    /// Database of a newer fleetcal.
    #[error(
        "the database {path} has schema {found}, this fleetcal knows schemas up to {known}; \
         run a newer fleetcal"
    )]
    NewerSchema {
        /// Path of the database.
        path: PathBuf,
        /// Newest migration in the database.
        found: i64,
        /// Newest migration in this program.
        known: i64,
    },
    /// Database server that cannot be used.
    #[error("the database {database} {reason}")]
    Server {
        /// Address of the database, without a password.
        database: String,
        /// Problem of the server, a clause.
        reason: String,
    },
    /// Schema of the running service that differs from this program's.
    #[error(
        "the running service keeps schema {found}, this fleetcal knows {known}; use the fleetcal \
         of the service"
    )]
    OtherSchema {
        /// Newest migration in the database.
        found: i64,
        /// Newest migration in this program.
        known: i64,
    },
    /// Missing database.
    #[error("there is no database at {path}; `fleetcal serve` makes one")]
    Missing {
        /// Path at which it was expected.
        path: PathBuf,
    },
    /// Missing part of the data.
    #[error("{} is gone, though {} is there; {remedy}", file.display(), left.display())]
    Gone {
        /// Missing file.
        file: PathBuf,
        /// Present file that proves its former existence.
        left: PathBuf,
        /// Remedy for the operator.
        remedy: &'static str,
    },
    /// Backup that cannot be written.
    #[error("the backup {path} cannot be written")]
    Backup {
        /// Path of the backup.
        path: PathBuf,
        /// Error of the system.
        #[source]
        source: Arc<std::io::Error>,
    },
    /// Refused restoration of a backup; nothing was changed.
    #[error("{} {reason}", path.display())]
    Restore {
        /// File that prevents it.
        path: PathBuf,
        /// Problem of the file.
        reason: String,
    },
    /// Failed migration to this program's schema.
    #[error("the database could not be brought to the schema of this fleetcal")]
    Migration(#[source] DriverError),
    /// Failure of the database.
    #[error("the database could not {task}")]
    Database {
        /// Failed task, an infinitive.
        task: &'static str,
        /// Error of the driver.
        #[source]
        source: DriverError,
    },
    /// Failure of a commit, whose outcome is unknown.
    #[error("the commit failed; the database may or may not have stored it")]
    Commit(#[source] DriverError),
    /// Robot that another instance estimates by now.
    #[error("robot {0} is estimated by another instance by now")]
    Fenced(RobotId),
    /// Rows that were not written before the store ended.
    #[error("{rows} rows that were not written yet are lost")]
    RowsLost {
        /// Number of the rows.
        rows: u64,
        /// Error of the last write; `None` if it did not end in time.
        #[source]
        source: Option<Box<Self>>,
    },
    /// Row that this program never writes.
    #[error("the database holds a {table} that cannot be read: {reason}")]
    Corrupt {
        /// Table of the row.
        table: &'static str,
        /// Problem of the row.
        reason: String,
    },
    /// Full queue of the writer.
    #[error("{waiting} writes already wait for the database")]
    QueueFull {
        /// Number of waiting writes.
        waiting: usize,
    },
    /// Write that waited too long for the busy writer.
    #[error(
        "the database did not take the write within {} s; nothing was changed",
        limits::STORE_ANSWER_WITHIN.as_secs()
    )]
    Late,
    /// Closed store.
    #[error("the store is closed")]
    Closed,
    /// Version conflict: the robot's configuration has changed since the caller read it.
    #[error("robot {robot} is at version {found}")]
    VersionConflict {
        /// Robot of the configuration.
        robot: RobotId,
        /// Present version; 0 before the first configuration.
        found: Version,
    },
    /// Full fleet: the robots would be more than it may have.
    #[error(
        "the fleet would have {robots} robots, expected {} at most",
        limits::ROBOTS_MAX
    )]
    RobotsMax {
        /// Number of configured robots that there would be.
        robots: usize,
    },
    /// Refused change of a user, session or token.
    #[error(transparent)]
    Account(#[from] AccountRefused),
    /// Refused command on the life cycle's records.
    #[error(transparent)]
    Refused(#[from] Refused),
    /// Refused acknowledgement of an alert.
    #[error(transparent)]
    Alert(#[from] AlertRefused),
    /// Refused change of a roll-out, or release of one of its robots.
    #[error(transparent)]
    Rollout(#[from] RolloutRefused),
    /// Refused webhook, or an unknown one.
    #[error(transparent)]
    Webhook(#[from] WebhookRefused),
    /// Repeated `Idempotency-Key` with another request.
    #[error("the Idempotency-Key was used before with another request")]
    KeyReused,
}

impl StoreError {
    /// True if this is an answer to the caller, and no failure of the database.
    pub const fn is_refusal(&self) -> bool {
        matches!(
            self,
            Self::VersionConflict { .. }
                | Self::RobotsMax { .. }
                | Self::KeyReused
                | Self::Late
                | Self::Fenced(_)
                | Self::Account(_)
                | Self::Refused(_)
                | Self::Alert(_)
                | Self::Rollout(_)
                | Self::Webhook(_)
        )
    }

    /// Makes an error of a driver, with the failed task as an infinitive.
    pub fn database<E>(task: &'static str) -> impl FnOnce(E) -> Self
    where
        E: std::error::Error + Send + Sync + 'static,
    {
        move |source| Self::Database {
            task,
            source: Arc::new(source),
        }
    }
}
