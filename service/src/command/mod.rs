//! The commands of `fleetcal`: what each takes, and what it does.

pub mod acl;
pub mod agent;
pub mod backup;
pub mod calibrate;
pub mod completions;
mod connection;
pub mod demo;
mod height_band;
mod known_map;
pub mod odometry;
mod output;
mod progress;
mod recording;
pub mod replay;
mod report;
pub mod serve;
mod session_record;
pub mod simulate;
mod stopping;
mod table;
mod timing;
pub mod token;
mod topics;
pub mod user;

use std::path::PathBuf;

use clap::{Parser, Subcommand, ValueEnum};
use fleetcal_estimator::VehicleModel;
use fleetcal_estimator::stream::FieldRefused;
use fleetcal_proto::RobotId;
use fleetcal_proto::robot_id::RobotIdRefused;
use fleetcal_proto::signing::TrustedKeysRefused;
use fleetcal_robot::agent::AgentError;
use fleetcal_robot::fleet::{FleetError, RecordError, TooManyRobots};
use fleetcal_robot::recording::{RecordingError, TopicError};
use fleetcal_robot::replay::ReplayError;
use thiserror::Error;

use crate::access::{GrantRefused, HashFailed, NameRefused, PasswordRefused};
use crate::config::{ConfigError, ValueRefused};
use crate::entropy::NoEntropy;
use crate::link::LinkError;
use crate::map_server::MapRefused;
use crate::service::ServiceError;
use crate::store::{AccountRefused, StoreError};

/// What the shell is told when the caller can mend it.
pub const EXIT_USAGE: u8 = 2;
/// What the shell is told when a recording cannot be used.
pub const EXIT_DATA: u8 = 65;
/// What the shell is told when reading or writing failed.
pub const EXIT_IO: u8 = 74;
/// What the shell is told when a part of the program failed by itself.
pub const EXIT_FAILED: u8 = 70;

/// Finds, online and during normal driving, how far a robot's steering zero is off and where its
/// LiDAR really sits.
#[derive(Debug, Parser)]
#[command(name = "fleetcal", version, propagate_version = true)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Calibrates the robot of one recording
    Calibrate(calibrate::Arguments),
    /// Writes the LiDAR's trajectory of one recording, by LiDAR odometry alone
    Odometry(odometry::Arguments),
    /// Runs the service
    Serve(serve::Arguments),
    /// Streams a recording to a service as its robot would
    Replay(replay::Arguments),
    /// Brings what is approved for a robot into use, on the robot itself
    Agent(agent::Arguments),
    /// Drives simulated robots, or records one
    Simulate(simulate::Arguments),
    /// Runs the service with six simulated robots, to look at
    Demo(demo::Arguments),
    /// Makes, lists and revokes API tokens; works beside a running service
    Token(token::Arguments),
    /// Makes, lists and changes users; works beside a running service
    User(user::Arguments),
    /// Copies the database into a file; works beside a running service
    Backup(backup::Arguments),
    /// Access lists of Zenoh routers
    Acl(acl::Arguments),
    /// Prints what a shell needs to complete flags: fleetcal completions bash
    Completions(completions::Arguments),
}

/// How a vehicle steers, as a flag says it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ModelName {
    /// Steered front axle (Ackermann too), speed measured at the rear axle.
    Bicycle,
    /// One steered and driven front wheel, speed measured at that wheel.
    Tricycle,
}

impl From<ModelName> for VehicleModel {
    fn from(name: ModelName) -> Self {
        match name {
            ModelName::Bicycle => Self::Bicycle,
            ModelName::Tricycle => Self::Tricycle,
        }
    }
}

/// Why a command failed, in one sentence.
#[derive(Debug, Error)]
pub enum CommandError {
    /// The recording cannot be read or used.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// Its topics cannot be chosen.
    #[error(transparent)]
    Topics(#[from] TopicError),
    /// The configuration file is refused.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The wheelbase given by flag cannot be.
    #[error("--wheelbase: {0}")]
    Wheelbase(#[from] ValueRefused),
    /// The joints given by flag do not go with the configuration.
    #[error("--joints: {0}")]
    Joints(String),
    /// The known map cannot be used.
    #[error(transparent)]
    Map(#[from] MapRefused),
    /// The start in it cannot be.
    #[error("--{0}")]
    Start(#[from] FieldRefused),
    /// The vehicle's size is not known.
    #[error(
        "the wheelbase is missing: give --wheelbase METRES, or a [[robot]] with id = \"{robot}\" \
         in a --config file"
    )]
    WheelbaseMissing {
        /// The robot of the recording.
        robot: String,
    },
    /// The robot's name is no id.
    #[error("{refused}; name the robot with --robot")]
    Robot {
        /// What is wrong with it.
        #[from]
        refused: RobotIdRefused,
    },
    /// Nothing in the recording can be used.
    #[error("{path}: none of the {messages} {what} messages can be used{first}", path = path.display())]
    Unusable {
        /// The recording.
        path: PathBuf,
        /// Which messages.
        what: &'static str,
        /// How many there are.
        messages: u64,
        /// Why the first one was refused, behind a colon.
        first: String,
    },
    /// A file could not be written.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// A result would take the recording's place.
    #[error("{} is of the recording itself, accepted is another file", .0.display())]
    OverRecording(PathBuf),
    /// A figure could not be drawn.
    #[error("cannot draw a figure: {0}")]
    Figure(String),
    /// The standard output could not be written.
    #[error("cannot write the result: {0}")]
    Stdout(#[from] std::io::Error),
    /// The service could not be started.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// A recording could not be streamed.
    #[error(transparent)]
    Replay(#[from] ReplayError),
    /// More robots than one process simulates.
    #[error("--robots: {0}")]
    TooManyRobots(#[from] TooManyRobots),
    /// A recording is of one robot.
    #[error("--robots is {robots}, accepted with --record is 1")]
    OneRobot {
        /// How many were asked for.
        robots: usize,
    },
    /// A robot's agent could not work.
    #[error(transparent)]
    Agent(#[from] AgentError),
    /// Too many keys to trust.
    #[error("--service-key: {0}")]
    Keys(#[from] TrustedKeysRefused),
    /// A file could not be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// A robot's own limits are refused.
    #[error("{}: {source}", path.display())]
    Limits {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: Box<toml::de::Error>,
    },
    /// A simulated robot could not be recorded.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// A simulated fleet failed.
    #[error(transparent)]
    Fleet(#[from] FleetError),
    /// The database of a data folder could not be read or changed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A user or token was not changed.
    #[error(transparent)]
    Account(#[from] AccountRefused),
    /// No user has this name.
    #[error("--name: no user {0:?} is known")]
    UserUnknown(String),
    /// The name cannot be one.
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
    #[error("--service is {0}, accepted is the name of no robot")]
    ServiceIsRobot(RobotId),
    /// What a router would know robots by is not there.
    #[error("--identity is {identity}, which needs {needs}")]
    Identity {
        /// The identity.
        identity: &'static str,
        /// The flags it needs.
        needs: &'static str,
    },
    /// A key expression that is the same for all robots.
    #[error(
        "--stream is {0:?}, accepted is a key expression in which one whole chunk is {{robot}}, for the robot's id"
    )]
    StreamOfAll(String),
    /// A task of the command ended early.
    #[error("a task of the command ended early: {0}")]
    Task(#[from] tokio::task::JoinError),
    /// The document could not be written as JSON.
    #[error("cannot write the result: {0}")]
    Json(#[from] serde_json::Error),
}

impl CommandError {
    /// What the shell is told.
    pub fn exit_status(&self) -> u8 {
        match self {
            Self::Recording(error) | Self::Record(RecordError::Recording(error)) => {
                error.exit_status()
            }
            Self::Topics(error) => error.exit_status(),
            Self::Replay(error) => error.exit_status(),
            Self::Map(refused) if !refused.is_io() => EXIT_DATA,
            Self::Agent(error) => error.exit_status(),
            Self::Map(_)
            | Self::Record(RecordError::Truth { .. })
            | Self::Config(ConfigError::Read { .. })
            | Self::Read { .. }
            | Self::Write { .. }
            | Self::Stdout(_)
            | Self::Json(_) => EXIT_IO,
            Self::Config(ConfigError::Refused { .. })
            | Self::Wheelbase(_)
            | Self::Joints(_)
            | Self::Start(_)
            | Self::WheelbaseMissing { .. }
            | Self::Robot { .. }
            | Self::Keys(_)
            | Self::Limits { .. }
            | Self::TooManyRobots(_)
            | Self::OneRobot { .. }
            | Self::Record(_)
            | Self::Service(
                ServiceError::Link(LinkError::Config(_)) | ServiceError::TooManyRobots { .. },
            )
            | Self::Store(StoreError::Account(_) | StoreError::Missing { .. })
            | Self::Account(_)
            | Self::UserUnknown(_)
            | Self::Name(_)
            | Self::Grant(_)
            | Self::Password(_)
            | Self::PasswordsDiffer
            | Self::NoRobots
            | Self::ServiceIsRobot(_)
            | Self::StreamOfAll(_)
            | Self::OverRecording(_)
            | Self::Identity { .. } => EXIT_USAGE,
            Self::Service(_) | Self::Fleet(_) | Self::Store(_) => EXIT_IO,
            Self::Task(_) | Self::Figure(_) | Self::Hash(_) | Self::Entropy(_) => EXIT_FAILED,
            Self::Unusable { .. } => EXIT_DATA,
        }
    }
}
