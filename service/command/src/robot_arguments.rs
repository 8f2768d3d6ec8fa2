//! Flags that name the robot of a recording, and describe its vehicle.

use std::path::PathBuf;

use clap::Args;
use fleetcal_config::Config;
use fleetcal_domain::robot::{RobotConfig, Wheelbase};
use fleetcal_domain::streams::{Joints, StreamsFields};
use fleetcal_estimator::{EstimatorSettings, VehicleModel};
use fleetcal_proto::RobotId;
use fleetcal_robot::recording::{Channel, Recording, Topics, choose_topics};

use crate::height_band::HeightBand;
use crate::topics::{self, TopicArguments};
use crate::{CommandError, ModelName};

/// Name of the robot if neither the caller nor the recording has one.
const UNNAMED: &str = "robot";

/// The flags.
#[derive(Debug, Args)]
pub struct RobotArguments {
    /// Distance between the axles, in metres
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    pub wheelbase: Option<f64>,
    /// Steering geometry of the vehicle [default: bicycle, or from --config]
    #[arg(long)]
    pub model: Option<ModelName>,
    /// The robot's name [default: the first chunk of the wheel odometry topic]
    #[arg(long, value_name = "NAME")]
    pub robot: Option<String>,
    /// Topics to use.
    #[command(flatten)]
    pub topics: TopicArguments,
    /// Joints that steer and drive, for `JointState`, as in `streams.joints` of a configuration
    #[arg(long, value_name = "TABLE", value_parser = topics::joints)]
    pub joints: Option<Joints>,
    /// A `fleetcal.toml`, for the estimator's settings, the robot's vehicle and its topics
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Heights to use from clouds, in the LiDAR's frame [default: -0.5,0.5, or from --config]
    #[arg(long, value_name = "MIN_M,MAX_M", allow_hyphen_values = true)]
    pub height_band: Option<HeightBand>,
}

/// The robot of a recording.
#[derive(Debug)]
pub struct RecordedRobot {
    /// Its name.
    pub id: RobotId,
    /// Its vehicle and streams.
    pub config: RobotConfig,
    /// The topics of the recording that are its streams.
    pub topics: Topics,
    /// The estimator's settings.
    pub settings: EstimatorSettings,
}

impl RobotArguments {
    /// Determines the robot of a recording: by the flags first, then the configuration file, then
    /// the recording.
    ///
    /// Returns an error when the file, a flag or the recording's topics cannot be used, or the
    /// wheelbase is missing.
    pub fn of(&self, recording: &Recording) -> Result<RecordedRobot, CommandError> {
        let file = self.config.as_deref().map(Config::read).transpose()?;
        let file = file.unwrap_or_default();
        let channels = recording.channels();
        let configured = configured_robot(self, channels, &file);
        let asked = match configured {
            Some((id, config)) => self
                .topics
                .asked_or_configured(id.as_str(), config, channels),
            None => self.topics.asked(),
        };
        let topics = choose_topics(channels, &asked)?;
        let name = self
            .robot
            .as_deref()
            .or(configured.map(|(id, _)| id.as_str()))
            .or_else(|| topics.robot())
            .unwrap_or(UNNAMED);
        let id = RobotId::parse(name)?;
        let config = vehicle_of(self, &id, &file)?;
        Ok(RecordedRobot {
            id,
            config,
            topics,
            settings: file.estimator,
        })
    }
}

/// Returns the recording's robot in the file: the one that is named, else the only one with topics
/// below its name.
fn configured_robot<'f>(
    arguments: &RobotArguments,
    channels: &[Channel],
    file: &'f Config,
) -> Option<(&'f RobotId, &'f RobotConfig)> {
    let is_it = |id: &RobotId| {
        if let Some(name) = &arguments.robot {
            return id.as_str() == name;
        }
        let below = format!("/{id}/");
        let mut topics = channels.iter().map(|channel| &channel.topic);
        topics.any(|topic| topic.starts_with(&below))
    };
    let mut fitting = file.robots.iter().filter(|entry| is_it(&entry.id));
    let only = fitting.next().filter(|_| fitting.next().is_none());
    only.map(|entry| (&entry.id, &entry.config))
}

/// Returns the vehicle: the flags first, then the robot's entry in the file.
fn vehicle_of(
    arguments: &RobotArguments,
    robot: &RobotId,
    file: &Config,
) -> Result<RobotConfig, CommandError> {
    let entry = file
        .robots
        .iter()
        .find(|entry| entry.id == *robot)
        .map(|entry| &entry.config);
    let given = arguments.wheelbase.map(Wheelbase::try_from).transpose()?;
    let wheelbase = given
        .or_else(|| entry.map(|config| config.wheelbase_m))
        .ok_or_else(|| CommandError::WheelbaseMissing {
            robot: robot.to_string(),
        })?;
    let model = arguments.model.map(VehicleModel::from);
    let mut config = entry.cloned().unwrap_or_else(|| {
        RobotConfig::of_vehicle(model.unwrap_or(VehicleModel::Bicycle), wheelbase)
    });
    config.wheelbase_m = wheelbase;
    if let Some(model) = model {
        config.model = model;
    }
    if let Some(joints) = &arguments.joints {
        let fields = StreamsFields {
            joints: Some(joints.clone()),
            ..config.streams.fields().clone()
        };
        config.streams = fields.try_into().map_err(CommandError::Joints)?;
    }
    config.point_cloud = Some(HeightBand::or_of(
        arguments.height_band,
        config.point_cloud.unwrap_or_default(),
    ));
    Ok(config)
}
