//! The commands that open no data folder: they work on recordings, beside a robot, or simulate
//! one.
//!
//! They know neither database nor HTTP API, so that a change of those does not compile them again.

pub mod agent;
pub mod calibrate;
mod connection;
mod described;
pub mod doctor;
mod height_band;
mod known_map;
pub mod map_server;
pub mod odometry;
pub mod output;
mod progress;
mod recording;
pub mod replay;
mod report;
mod robot_arguments;
pub mod schema;
mod session_record;
pub mod signals;
pub mod simulate;
mod table;
mod timing;
mod topics;
pub mod trust;
pub mod verify;
pub mod zenoh_words;

use std::path::PathBuf;
use std::pin::Pin;

use clap::ValueEnum;
use fleetcal_config::ConfigError;
use fleetcal_description::DescriptionRefused;
use fleetcal_domain::robot::ValueRefused;
use fleetcal_estimator::VehicleModel;
use fleetcal_estimator::stream::FieldRefused;
use fleetcal_model::RobotIdRefused;
use fleetcal_proto::signing::TrustedKeysRefused;
use fleetcal_robot::agent::AgentError;
use fleetcal_robot::fleet::{FleetError, RecordError, TooManyRobots};
use fleetcal_robot::recording::{RecordingError, TopicError};
use fleetcal_robot::replay::ReplayError;
use thiserror::Error;

use crate::map_server::MapRefused;

/// Future of a running command. It is compiled in this crate instead of the one that awaits it.
pub type Boxed<'a> = Pin<Box<dyn Future<Output = Result<(), CommandError>> + 'a>>;

/// Exit status of checks that named a cause, or refused a certificate.
pub const EXIT_FOUND: u8 = 1;
/// Exit status of errors that the caller can correct.
pub const EXIT_USAGE: u8 = 2;
/// Exit status of an unusable recording.
pub const EXIT_DATA: u8 = 65;
/// Exit status of failed reading or writing.
pub const EXIT_IO: u8 = 74;
/// Exit status of a part of the program that failed by itself.
pub const EXIT_FAILED: u8 = 70;

/// Steering geometry of a vehicle, in the form of a flag.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ModelName {
    /// Steered front axle (Ackermann too), speed measured at the rear axle.
    Bicycle,
    /// One steered and driven front wheel, speed measured at that wheel.
    Tricycle,
    /// Steered axle behind the fixed one (forklifts), speed measured at the fixed axle.
    #[value(name = "rear_steered")]
    RearSteered,
}

impl From<ModelName> for VehicleModel {
    fn from(name: ModelName) -> Self {
        match name {
            ModelName::Bicycle => Self::Bicycle,
            ModelName::Tricycle => Self::Tricycle,
            ModelName::RearSteered => Self::RearSteered,
        }
    }
}

/// Error of a command, in one sentence.
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
    /// The wheelbase given by flag is impossible.
    #[error("--wheelbase: {0}")]
    Wheelbase(#[from] ValueRefused),
    /// The joints given by flag do not fit the configuration.
    #[error("--joints: {0}")]
    Joints(String),
    /// The known map cannot be used.
    #[error(transparent)]
    Map(#[from] MapRefused),
    /// The start in the map is impossible.
    #[error("--{0}")]
    Start(#[from] FieldRefused),
    /// The vehicle's size is unknown.
    #[error(
        "the wheelbase is missing: give --wheelbase METRES, a --urdf FILE, or a [[robot]] with id = \
         \"{robot}\" in a --config file{described}"
    )]
    WheelbaseMissing {
        /// The robot of the recording.
        robot: String,
        /// Reason for which its description does not give it, behind a semicolon.
        described: String,
    },
    /// The vehicle's steering is unknown although it is described.
    #[error("the model is missing: give --model; its description does not say it: {described}")]
    ModelMissing {
        /// Reason for which its description does not give it.
        described: String,
    },
    /// The file of `--urdf` is refused.
    #[error("--urdf {}: {refused}", path.display())]
    Description {
        /// The file.
        path: PathBuf,
        /// Fault of the file.
        refused: DescriptionRefused,
    },
    /// The robot's name is not a valid id.
    #[error("{refused}; name the robot with --robot")]
    Robot {
        /// Fault of the name.
        #[from]
        refused: RobotIdRefused,
    },
    /// All messages of one kind in the recording are unusable.
    #[error("{path}: none of the {messages} {what} messages can be used{first}", path = path.display())]
    Unusable {
        /// The recording.
        path: PathBuf,
        /// The unusable messages.
        what: &'static str,
        /// Number of messages.
        messages: u64,
        /// Reason for the first refusal, behind a colon.
        first: String,
    },
    /// A file could not be written.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// A result would overwrite the recording.
    #[error("{} is of the recording itself, expected another file", .0.display())]
    OverRecording(PathBuf),
    /// A figure could not be drawn.
    #[error("cannot draw a figure: {0}")]
    Figure(String),
    /// The standard output could not be written.
    #[error("cannot write the result: {0}")]
    Stdout(#[from] std::io::Error),
    /// A recording could not be streamed.
    #[error(transparent)]
    Replay(#[from] ReplayError),
    /// More robots than one process simulates.
    #[error("--robots: {0}")]
    TooManyRobots(#[from] TooManyRobots),
    /// A recording holds one robot.
    #[error("--robots: got {robots}, expected 1 with --record")]
    OneRobot {
        /// Number of robots that were requested.
        robots: usize,
    },
    /// A robot's agent failed.
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
        /// Error of the system.
        source: std::io::Error,
    },
    /// A robot's own limits are refused.
    #[error("{}: {source}", path.display())]
    Limits {
        /// The file.
        path: PathBuf,
        /// Error in the file.
        source: Box<toml::de::Error>,
    },
    /// The simulated imperfections are refused.
    #[error("{}: {reason}", path.display())]
    Imperfections {
        /// The file.
        path: PathBuf,
        /// The error and its place.
        reason: String,
    },
    /// A simulated robot could not be recorded.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// A simulated fleet failed.
    #[error(transparent)]
    Fleet(#[from] FleetError),
    /// A task of the command ended early.
    #[error("a task of the command ended early: {0}")]
    Task(#[from] tokio::task::JoinError),
    /// The joining checks named causes, which were printed.
    #[error("{causes} found wrong with the recording")]
    Found {
        /// Number of causes.
        causes: usize,
    },
    /// Too many keys to trust.
    #[error("--key: {0}")]
    VerifyKeys(#[source] TrustedKeysRefused),
    /// A certificate is not genuine.
    #[error("{}: line {line}: refused: {refused}", path.display())]
    Certificate {
        /// The file.
        path: PathBuf,
        /// Line of the file.
        line: u64,
        /// The check that failed.
        refused: String,
    },
    /// The changes of key cannot be used.
    #[error("--key-changes: {}: {reason}", path.display())]
    KeyChanges {
        /// The file.
        path: PathBuf,
        /// Fault of the file.
        reason: String,
    },
    /// A file without a certificate.
    #[error("{}: got nothing, expected a certificate", .0.display())]
    NoCertificate(PathBuf),
    /// A page shows one certificate.
    #[error("--html: got {certificates} certificates, expected one")]
    OnePage {
        /// Number of certificates of the file.
        certificates: u64,
    },
    /// The document could not be written as JSON.
    #[error("cannot write the result: {0}")]
    Json(#[from] serde_json::Error),
}

impl CommandError {
    /// Returns the exit status of the program.
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
            | Self::Json(_)
            | Self::Fleet(_) => EXIT_IO,
            Self::Config(ConfigError::Refused { .. })
            | Self::Wheelbase(_)
            | Self::Joints(_)
            | Self::Start(_)
            | Self::WheelbaseMissing { .. }
            | Self::ModelMissing { .. }
            | Self::Description { .. }
            | Self::Robot { .. }
            | Self::Keys(_)
            | Self::VerifyKeys(_)
            | Self::KeyChanges { .. }
            | Self::OnePage { .. }
            | Self::Limits { .. }
            | Self::Imperfections { .. }
            | Self::TooManyRobots(_)
            | Self::OneRobot { .. }
            | Self::Record(_)
            | Self::OverRecording(_) => EXIT_USAGE,
            Self::Found { .. } | Self::Certificate { .. } | Self::NoCertificate(_) => EXIT_FOUND,
            Self::Task(_) | Self::Figure(_) => EXIT_FAILED,
            Self::Unusable { .. } => EXIT_DATA,
        }
    }
}
