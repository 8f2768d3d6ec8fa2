//! Flags that name the robot of a recording, and describe its vehicle.

use std::path::PathBuf;

use clap::Args;
use fleetcal_config::Config;
use fleetcal_domain::robot::{DescribedConfig, RobotConfig, Wheelbase};
use fleetcal_domain::streams::{Joints, StreamsFields};
use fleetcal_estimator::{EstimatorSettings, VehicleModel};
use fleetcal_proto::RobotId;
use fleetcal_proto::description::DescriptionDocument;
use fleetcal_robot::recording::{Channel, Recording, Topics, choose_topics};

use crate::described::{RecordedDescription, ask_for_joints, scan_frame};
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
    /// The robot's URDF: its vehicle, joints and LiDAR mount, where no flag or configuration gives
    /// them [default: the recording's own `/robot_description`]
    #[arg(long, value_name = "FILE")]
    pub urdf: Option<PathBuf>,
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
    /// Configuration by its own description, if it has one.
    pub description: Option<DescriptionDocument>,
}

impl RobotArguments {
    /// Determines the robot of a recording: by the flags first, then the configuration file, then
    /// the robot's own description, then the recording.
    ///
    /// Returns an error when a file, a flag or the recording's topics cannot be used, or the
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
        let described = self.described(recording, configured)?;
        let by_itself = DescribedConfig::of(&described.description.propose(None));
        let asked = match &by_itself.joints {
            Some(joints) => ask_for_joints(recording, joints, asked)?,
            None => asked,
        };
        let topics = choose_topics(channels, &asked)?;
        let name = self
            .robot
            .as_deref()
            .or(configured.map(|(id, _)| id.as_str()))
            .or_else(|| topics.robot())
            .unwrap_or(UNNAMED);
        let id = RobotId::parse(name)?;
        let frame = scan_frame(recording, &topics)?;
        let by_itself = DescribedConfig::of(&described.description.propose(frame.as_deref()));
        let config = vehicle_of(self, &id, &file, (&described, &by_itself))?;
        Ok(RecordedRobot {
            description: document(described, &by_itself, &config),
            id,
            config,
            topics,
            settings: file.estimator,
        })
    }

    /// Finds the description. Files beside the recording are read where the vehicle is not known
    /// otherwise.
    fn described(
        &self,
        recording: &Recording,
        configured: Option<(&RobotId, &RobotConfig)>,
    ) -> Result<RecordedDescription, CommandError> {
        let robot = self.robot.as_deref();
        let robot = robot.or(configured.map(|(id, _)| id.as_str()));
        let mut described = RecordedDescription::read(recording, self.urdf.as_deref(), robot)?;
        if self.wheelbase.is_none() && configured.is_none() {
            described.look_beside(recording, robot);
        }
        Ok(described)
    }
}

/// Makes the document of a description; `None` if nothing was found.
fn document(
    described: RecordedDescription,
    by_itself: &DescribedConfig,
    config: &RobotConfig,
) -> Option<DescriptionDocument> {
    if described.is_empty() && described.remarks.is_empty() {
        return None;
    }
    let mut document = by_itself.document(described.origins, Some(config));
    document.remarks.extend(described.remarks);
    Some(document)
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

/// Returns the vehicle: the flags first, then the robot's entry in the file, then its description.
fn vehicle_of(
    arguments: &RobotArguments,
    robot: &RobotId,
    file: &Config,
    (found, described): (&RecordedDescription, &DescribedConfig),
) -> Result<RobotConfig, CommandError> {
    let entry = file
        .robots
        .iter()
        .find(|entry| entry.id == *robot)
        .map(|entry| &entry.config);
    let given = arguments.wheelbase.map(Wheelbase::try_from).transpose()?;
    let wheelbase = given
        .or_else(|| entry.map(|config| config.wheelbase_m))
        .or(described.wheelbase_m)
        .ok_or_else(|| CommandError::WheelbaseMissing {
            robot: robot.to_string(),
            described: why_without_wheelbase(found, described),
        })?;
    let model = arguments.model.map(VehicleModel::from);
    let mut config = match entry {
        Some(entry) => entry.clone(),
        None => RobotConfig {
            speed_measured_at: described.speed_measured_at.filter(|_| model.is_none()),
            ..RobotConfig::of_vehicle(model_of(model, described)?, wheelbase)
        },
    };
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
    described.fill(&mut config);
    config.point_cloud = Some(HeightBand::or_of(
        arguments.height_band,
        config.point_cloud.unwrap_or_default(),
    ));
    Ok(config)
}

/// Returns why a description does not give the wheelbase, behind a semicolon; nothing without a
/// description.
fn why_without_wheelbase(found: &RecordedDescription, described: &DescribedConfig) -> String {
    if let Some(remark) = found.remarks.first() {
        return format!("; {remark}");
    }
    let reason = described.reason("wheelbase_m");
    match reason.filter(|_| found.description.has_urdf()) {
        Some(reason) => format!("; its description does not say it: {reason}"),
        None => String::new(),
    }
}

/// Returns the model of a vehicle that is in no file: that of the flag, else the described one. One
/// that is not described at all is a bicycle.
fn model_of(
    given: Option<VehicleModel>,
    described: &DescribedConfig,
) -> Result<VehicleModel, CommandError> {
    match (given.or(described.model), described.reason("model")) {
        (Some(model), _) => Ok(model),
        (None, Some(reason)) if described.wheelbase_m.is_some() => {
            Err(CommandError::ModelMissing {
                described: reason.to_owned(),
            })
        }
        (None, _) => Ok(VehicleModel::Bicycle),
    }
}

#[cfg(test)]
mod tests;
