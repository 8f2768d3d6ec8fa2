//! The commands of `fleetcal`: what each takes, and what it does.

pub mod acl;
pub mod audit;
pub mod backup;
pub mod check_config;
pub mod completions;
pub mod demo;
pub mod key;
pub mod man;
mod passwords;
pub mod restore;
pub mod serve;
mod stopping;
pub mod store;
pub mod support;
pub mod token;
pub mod user;

use std::path::PathBuf;

use clap::{Parser, Subcommand};
use fleetcal_command::{
    EXIT_FAILED, EXIT_IO, EXIT_USAGE, agent, calibrate, doctor, odometry, replay, schema, simulate,
    verify,
};
use fleetcal_config::ConfigError;
use fleetcal_domain::access::{
    AccountRefused, GrantRefused, HashFailed, NameRefused, PasswordRefused,
};
use fleetcal_domain::robot::ValueRefused;
use fleetcal_folder::signing_key::KeyError;
use fleetcal_link::LinkError;
use fleetcal_operations::api_client::ApiError;
use fleetcal_operations::entropy::NoEntropy;
use fleetcal_proto::RobotId;
use fleetcal_robot::fleet::{FleetError, TooManyRobots};
use fleetcal_store::StoreError;
use fleetcal_store::database_url::DatabaseUrlRefused;
use thiserror::Error;

use crate::database::DatabaseError;
use crate::service::ServiceError;

/// Calibrates fleets of wheeled robots during normal driving: the steering offset and the pose of
/// the LiDAR.
#[derive(Debug, Parser)]
#[command(name = "fleetcal", version, propagate_version = true)]
pub struct Cli {
    /// The command.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Calibrates the robot of a recording
    Calibrate(calibrate::Arguments),
    /// Names what is wrong with the inputs of a recording
    Doctor(doctor::Arguments),
    /// Writes the LiDAR's trajectory of a recording, by LiDAR odometry alone
    Odometry(odometry::Arguments),
    /// Runs the service
    Serve(serve::Arguments),
    /// Streams a recording to a service as its robot would
    Replay(replay::Arguments),
    /// Runs on a robot: applies and acknowledges its approved calibrations
    Agent(agent::Arguments),
    /// Simulates robots that drive, or records one
    Simulate(simulate::Arguments),
    /// Runs the service with six simulated robots
    Demo(demo::Arguments),
    /// Creates, lists and revokes API tokens, also while the service runs
    Token(token::Arguments),
    /// Creates, lists and changes users, also while the service runs
    User(user::Arguments),
    /// Replaces the signing key, without a robot that stands still
    Key(key::Arguments),
    /// Shows whether rows of the audit were changed or removed
    Audit(audit::Arguments),
    /// Writes the support bundle of a robot, from a running service
    Support(support::Arguments),
    /// Copies the database into a file, also while the service runs
    Backup(backup::Arguments),
    /// Puts a backup into an empty data folder, and the signing key with it
    Restore(restore::Arguments),
    /// Brings a PostgreSQL up to date, or fills it from a data folder
    Store(store::Arguments),
    /// Generates access lists of Zenoh routers
    Acl(acl::Arguments),
    /// Checks a `fleetcal.toml` without starting the service
    CheckConfig(check_config::Arguments),
    /// Prints the completions of a shell: fleetcal completions bash
    Completions(completions::Arguments),
    /// Prints the JSON Schema of a command's output with --json
    Schema(schema::Arguments),
    /// Checks certificates of verified calibrations, without a service
    Verify(verify::Arguments),
    /// Writes the manual pages into a folder
    Man(man::Arguments),
}

/// Error of a command, in one sentence.
#[derive(Debug, Error)]
pub enum CommandError {
    /// A command that opens no data folder failed, or a step that all commands share.
    #[error(transparent)]
    WithoutData(Box<fleetcal_command::CommandError>),
    /// The signing key was not replaced.
    #[error(transparent)]
    Key(#[from] KeyError),
    /// The service could not be started.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// The database of a data folder could not be read or changed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The command has no database.
    #[error(transparent)]
    Database(#[from] DatabaseError),
    /// The URL of a database is refused.
    #[error("--database: {0}")]
    DatabaseUrl(#[from] DatabaseUrlRefused),
    /// An instance may not contact another one as configured.
    #[error("--peer: {0}")]
    Cluster(String),
    /// The URL of a copy is refused.
    #[error("--to: {0}")]
    CopyTo(DatabaseUrlRefused),
    /// The command names no PostgreSQL.
    #[error("no database is named: give --database URL")]
    NoPostgres,
    /// The audit is not as it was written, or cannot be checked.
    #[error(transparent)]
    Audit(#[from] audit::AuditFault),
    /// A user or token was not changed.
    #[error(transparent)]
    Account(#[from] AccountRefused),
    /// The user name is unknown.
    #[error("--name: no user {0:?} is known")]
    UserUnknown(String),
    /// The name is not a valid name.
    #[error("--name: {0}")]
    Name(#[from] NameRefused),
    /// Role and robot do not go together.
    #[error("--role, --robot: {0}")]
    Grant(#[from] GrantRefused),
    /// The password is too short or too long.
    #[error(transparent)]
    Password(#[from] PasswordRefused),
    /// The password was typed differently the second time.
    #[error("the two passwords are not the same")]
    PasswordsDiffer,
    /// The password could not be hashed.
    #[error(transparent)]
    Hash(#[from] HashFailed),
    /// The system has no randomness.
    #[error("the system gives no random bytes: {0}")]
    Entropy(#[from] NoEntropy),
    /// An access list of no robot.
    #[error("no robot is named: give --robot ID, or a --config file with a [[robot]]")]
    NoRobots,
    /// A robot would have the service's rights.
    #[error("--service: got {0}, expected the name of no robot")]
    ServiceIsRobot(RobotId),
    /// A robot would have the rights of another router.
    #[error("--router: got {0}, expected the name of no robot")]
    RouterIsRobot(String),
    /// The files of the identification are missing.
    #[error("--identity is {identity}, which needs {needs}")]
    Identity {
        /// The identity.
        identity: &'static str,
        /// The flags it needs.
        needs: &'static str,
    },
    /// The file of the passwords cannot be made or used.
    #[error("--passwords: {}: {reason}", path.display())]
    Passwords {
        /// The file.
        path: PathBuf,
        /// Fault of the file.
        reason: String,
    },
    /// A running service gave no answer, or refused.
    #[error(transparent)]
    Api(#[from] ApiError),
    /// A request needs a token.
    #[error("no API token: give --token-file FILE, or set FLEETCAL_TOKEN")]
    NoToken,
    /// The list of a support bundle is no list.
    #[error("the service's list of the bundle cannot be read: {0}")]
    Support(String),
    /// A key expression that is the same for all robots.
    #[error(
        "--stream: got {0:?}, expected a key expression in which one whole chunk is {{robot}}, for the robot's id"
    )]
    StreamOfAll(String),
}

/// Implements conversions of causes that the crate of the commands without data folder describes.
macro_rules! from_without_data {
    ($($cause:ty),+) => {$(
        impl From<$cause> for CommandError {
            fn from(cause: $cause) -> Self {
                Self::WithoutData(Box::new(cause.into()))
            }
        }
    )+};
}

from_without_data!(
    ConfigError,
    FleetError,
    std::io::Error,
    tokio::task::JoinError,
    TooManyRobots,
    ValueRefused
);

impl From<fleetcal_command::CommandError> for CommandError {
    fn from(error: fleetcal_command::CommandError) -> Self {
        Self::WithoutData(Box::new(error))
    }
}

impl CommandError {
    /// Returns the exit status of the program.
    pub fn exit_status(&self) -> u8 {
        match self {
            Self::WithoutData(error) => error.exit_status(),
            Self::Service(
                ServiceError::Link(
                    LinkError::Config(_) | LinkError::Passwords(_) | LinkError::Anonymous { .. },
                )
                | ServiceError::TooManyRobots { .. }
                | ServiceError::NothingShared { .. }
                | ServiceError::Peers(_),
            )
            | Self::Store(
                StoreError::Account(_) | StoreError::Missing { .. } | StoreError::Restore { .. },
            )
            | Self::Account(_)
            | Self::UserUnknown(_)
            | Self::Name(_)
            | Self::Grant(_)
            | Self::Password(_)
            | Self::PasswordsDiffer
            | Self::NoRobots
            | Self::Database(
                DatabaseError::Url(_)
                | DatabaseError::NotNamed
                | DatabaseError::CopiedElsewhere(_)
                | DatabaseError::Store(StoreError::Missing { .. }),
            )
            | Self::DatabaseUrl(_)
            | Self::Cluster(_)
            | Self::CopyTo(_)
            | Self::NoPostgres
            | Self::ServiceIsRobot(_)
            | Self::RouterIsRobot(_)
            | Self::StreamOfAll(_)
            | Self::NoToken
            | Self::Api(
                ApiError::Plaintext(_)
                | ApiError::Refused {
                    status: 400..=499, ..
                },
            )
            | Self::Passwords { .. }
            | Self::Identity { .. } => EXIT_USAGE,
            Self::Audit(fault) => fault.exit_status(),
            Self::Key(_)
            | Self::Service(_)
            | Self::Store(_)
            | Self::Database(_)
            | Self::Api(_)
            | Self::Support(_) => EXIT_IO,
            Self::Hash(_) | Self::Entropy(_) => EXIT_FAILED,
        }
    }
}
