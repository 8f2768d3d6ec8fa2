//! `fleetcal agent`: the robot's side of an approved calibration.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use fleetcal_clock::SharedClock;
use fleetcal_model::{Pose2, RobotTime};
use fleetcal_proto::signing::{PublicKey, TrustedKeys};
use fleetcal_proto::{KeyRoot, Keys, RobotId};
use fleetcal_robot::agent::{
    AgentOptions, Hook, Limits, OutputKind, Outputs, VehicleFrames, run_agent,
};
use tokio_util::sync::CancellationToken;

use crate::connection::ConnectionArguments;
use crate::output::print_text;
use crate::signals::Signals;
use crate::{Boxed, CommandError};

/// Explanation of hooks and of behaviour that no single flag covers.
const LONG_HELP: &str = "\
The agent asks the service for the approved calibration for its robot: at its start, whenever a service comes \
up, and once a minute; what the service pushes arrives at once. A document is taken when it is signed \
with a trusted key, for this robot, of a higher generation than any before, and inside the robot's \
limits; else it is refused, and the service is told why. The file is replaced as a whole or not at \
all. Without the service's confirmation in time the former file comes back by itself. What the agent \
remembers stands beside the file, in FILE.agent.json.

The hook is called, without a shell, with FLEETCAL_CALL in its environment:
  check     may the values be applied now?  exit 0: yes, 75: busy, ask again in 15 s
  applied   the file says them: reload it.  exit 0: done, 75: not now, the former file comes back
  reverted  the former file is back: reload it
Any other exit status is a failure; what the hook says on standard error is its reason. After a \
restart of the agent a call may come once more. FLEETCAL_ROBOT, FLEETCAL_GENERATION and FLEETCAL_FILE \
say what it is about; the signed document is on standard input.

Exit status: 0 told to stop, 2 wrong flags or files, 70 a fault of the agent, 74 reading, writing or \
connecting failed.";

/// Longest timeout of a hook, s: deadlines wait for its answer.
const HOOK_TIMEOUT_MAX_S: u64 = 600;

/// Arguments of `fleetcal agent`.
#[derive(Debug, Args)]
#[command(after_long_help = LONG_HELP)]
pub struct Arguments {
    /// The robot's id
    #[arg(long, value_name = "ID", value_parser = RobotId::parse)]
    pub robot: RobotId,
    /// Connection to the service.
    #[command(flatten)]
    pub connection: ConnectionArguments,
    /// The file that the robot's software reads its calibration from, YAML or JSON by its ending
    /// (.yaml, .yml, .json); it is created if missing
    #[arg(long, value_name = "FILE")]
    pub apply: PathBuf,
    /// The service's public key, from `GET /api/v1/signing-key`; may be repeated
    #[arg(long, value_name = "PUBLICKEY", required = true)]
    pub service_key: Vec<PublicKey>,
    /// A program that decides whether values may be written, and is called again after they were
    /// written or reverted; it receives the document on its standard input
    #[arg(long, value_name = "PROGRAM")]
    pub hook: Option<PathBuf>,
    /// An argument for the hook; may be repeated
    #[arg(
        long,
        value_name = "ARGUMENT",
        requires = "hook",
        allow_hyphen_values = true
    )]
    pub hook_arg: Vec<String>,
    /// Time after which a hook is killed and counts as failed, in seconds
    #[arg(
        long,
        value_name = "SECONDS",
        default_value_t = 60,
        value_parser = clap::value_parser!(u64).range(1..=HOOK_TIMEOUT_MAX_S)
    )]
    pub hook_timeout: u64,
    /// A TOML file with the robot's own limits, `steering_offset_rad = [-0.1, 0.1]` and so on;
    /// missing keys keep their defaults
    #[arg(long, value_name = "FILE")]
    pub limits: Option<PathBuf>,
    /// Announce the robot's presence while the agent runs, for robots whose streams do not
    #[arg(long)]
    pub alive: bool,
    /// First chunk of every key
    #[arg(long, value_name = "CHUNK", default_value = "fleet", value_parser = KeyRoot::parse)]
    pub root: KeyRoot,
    /// Output files for ROS.
    #[command(flatten)]
    pub ros: RosArguments,
}

/// Additional output files for ROS.
#[derive(Debug, Args)]
pub struct RosArguments {
    /// Also write a xacro file, whose macro `fleetcal_lidar_origin` is the origin of the LiDAR's
    /// joint
    #[arg(long, value_name = "FILE", help_heading = "Files for ROS")]
    pub urdf_origin: Option<PathBuf>,
    /// Also write a script that runs a `static_transform_publisher`
    #[arg(long, value_name = "FILE", help_heading = "Files for ROS")]
    pub static_transform: Option<PathBuf>,
    /// Also write node parameters, for `ros2 run … --ros-args --params-file`
    #[arg(long, value_name = "FILE", help_heading = "Files for ROS")]
    pub ros_parameters: Option<PathBuf>,
    /// Also replace x, y and yaw in the origin of the LiDAR's joint in this URDF; the file as it was
    /// is kept beside it
    #[arg(long, value_name = "FILE", help_heading = "Files for ROS")]
    pub urdf_joint: Option<PathBuf>,
    /// Also replace x, y and yaw of the LiDAR in Autoware's `sensors_calibration.yaml`; the file as
    /// it was is kept beside it
    #[arg(long, value_name = "FILE", help_heading = "Files for ROS")]
    pub autoware_calibration: Option<PathBuf>,
    /// Also write the curve of the steering as CSV, for information: measured angle, true angle and its
    /// standard deviation, rad. The file is there while the calibration in use has a curve
    #[arg(long, value_name = "FILE", help_heading = "Files for controllers")]
    pub steering_table: Option<PathBuf>,
    /// Pose of the rear axle's centre in the base frame [default: from the robot's configuration at
    /// the service, or the origin]
    #[arg(
        long,
        value_name = "X_M,Y_M,YAW_RAD",
        value_parser = planar_pose,
        allow_hyphen_values = true,
        help_heading = "Files for ROS"
    )]
    pub rear_axle_in_base_link: Option<Pose2>,
    /// Height of the LiDAR over the base frame, m
    #[arg(
        long,
        value_name = "METRES",
        default_value_t = 0.0,
        allow_hyphen_values = true,
        help_heading = "Files for ROS"
    )]
    pub lidar_z: f64,
    /// Name of the base frame
    #[arg(
        long,
        value_name = "FRAME",
        default_value = "base_link",
        value_parser = frame_name,
        help_heading = "Files for ROS"
    )]
    pub base_frame: String,
    /// Name of the LiDAR's frame
    #[arg(
        long,
        value_name = "FRAME",
        default_value = "laser",
        value_parser = frame_name,
        help_heading = "Files for ROS"
    )]
    pub lidar_frame: String,
}

impl RosArguments {
    fn outputs(&self) -> Outputs {
        let files = [
            (OutputKind::UrdfOrigin, &self.urdf_origin),
            (OutputKind::StaticTransform, &self.static_transform),
            (OutputKind::RosParameters, &self.ros_parameters),
            (OutputKind::UrdfJoint, &self.urdf_joint),
            (OutputKind::AutowareCalibration, &self.autoware_calibration),
            (OutputKind::SteeringTable, &self.steering_table),
        ];
        let named = files.into_iter();
        Outputs {
            files: named
                .filter_map(|(kind, path)| Some((kind, path.clone()?)))
                .collect(),
            frames: VehicleFrames {
                rear_axle_in_base_link: self.rear_axle_in_base_link,
                lidar_z_m: self.lidar_z,
                base_link: self.base_frame.clone(),
                lidar: self.lidar_frame.clone(),
            },
        }
    }
}

/// Parses three finite numbers.
fn planar_pose(text: &str) -> Result<Pose2, String> {
    let numbers: Option<Vec<f64>> = text
        .split(',')
        .map(|part| {
            part.trim()
                .parse()
                .ok()
                .filter(|number: &f64| number.is_finite())
        })
        .collect();
    match numbers.as_deref() {
        Some(&[x_m, y_m, yaw_rad]) => Ok(Pose2 { x_m, y_m, yaw_rad }),
        _ => Err("expected three numbers, metres and radians: -0.4,0,0".to_owned()),
    }
}

/// Checks a frame's name, which ends up in XML and in a shell command.
fn frame_name(text: &str) -> Result<String, String> {
    let good = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '/' | '-' | '.');
    if !text.is_empty() && !text.starts_with('-') && text.chars().all(good) {
        return Ok(text.to_owned());
    }
    Err("expected letters, digits, _, -, . and /".to_owned())
}

/// Runs until SIGTERM or SIGINT.
///
/// # Errors
/// One sentence, with its exit status.
pub fn run(arguments: &Arguments, clock: SharedClock) -> Boxed<'_> {
    Box::pin(perform(arguments, clock))
}

async fn perform(arguments: &Arguments, clock: SharedClock) -> Result<(), CommandError> {
    let limits = match &arguments.limits {
        Some(path) => read_limits(path)?,
        None => Limits::default(),
    };
    let mut signals = Signals::listen()?;
    let options = AgentOptions {
        robot: arguments.robot.clone(),
        connect: arguments.connection.connection(),
        keys: Keys::new(arguments.root.clone()),
        apply: arguments.apply.clone(),
        outputs: arguments.ros.outputs(),
        trusted: TrustedKeys::new(arguments.service_key.clone())?,
        limits,
        hook: hook(arguments),
        holds_alive_token: arguments.alive,
        // The agent runs on the robot: this clock is the robot's.
        start_ns: RobotTime(clock.now().0),
    };
    let stop = CancellationToken::new();
    let agent = run_agent(options, stop.clone());
    tokio::pin!(agent);
    let generation = tokio::select! {
        ended = &mut agent => ended?,
        () = signals.stop() => {
            stop.cancel();
            agent.await?
        }
    };
    let robot = &arguments.robot;
    print_text(&format!("{robot}: holds calibration {generation}\n"))
}

fn hook(arguments: &Arguments) -> Option<Hook> {
    Some(Hook {
        program: arguments.hook.clone()?,
        arguments: arguments.hook_arg.clone(),
        timeout: Duration::from_secs(arguments.hook_timeout),
    })
}

fn read_limits(path: &Path) -> Result<Limits, CommandError> {
    let text = std::fs::read_to_string(path).map_err(|source| CommandError::Read {
        path: path.to_owned(),
        source,
    })?;
    toml::from_str(&text).map_err(|source| CommandError::Limits {
        path: path.to_owned(),
        source: Box::new(source),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limits(text: &str) -> Result<Limits, CommandError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("limits.toml");
        std::fs::write(&path, text).unwrap();
        read_limits(&path)
    }

    #[test]
    fn frames_and_poses_are_checked() {
        let pose = planar_pose("-0.4, 0.1,1.5").unwrap();
        let wanted = Pose2 {
            x_m: -0.4,
            y_m: 0.1,
            yaw_rad: 1.5,
        };
        assert_eq!(pose, wanted);
        for text in ["", "1,2", "1,2,3,4", "1,2,nan", "a,b,c"] {
            assert!(planar_pose(text).is_err(), "{text}");
        }
        assert_eq!(
            frame_name("robot/base_link").as_deref(),
            Ok("robot/base_link")
        );
        for text in ["", "-x", "a b", "a;b", "a\"b"] {
            assert!(frame_name(text).is_err(), "{text}");
        }
    }

    #[test]
    fn limits_keep_their_defaults_and_refuse_what_they_do_not_know() {
        let read = limits("steering_offset_rad = [-0.1, 0.1]\nlidar_x_m = [0, 1]\n").unwrap();
        let expected = Limits {
            steering_offset_rad: fleetcal_robot::agent::Range::new(-0.1, 0.1).unwrap(),
            lidar_x_m: fleetcal_robot::agent::Range::new(0.0, 1.0).unwrap(),
            ..Limits::default()
        };
        assert_eq!(read, expected);
        for (text, wanted) in [
            ("steering = [0, 1]", "steering"),
            ("lidar_x_m = [1, 0]", "[1, 0]"),
            ("lidar_x_m = 1", "lidar_x_m"),
        ] {
            let error = limits(text).unwrap_err();
            let sentence = error.to_string();
            assert!(
                sentence.contains(wanted) && error.exit_status() == 2,
                "{sentence}"
            );
        }
        let missing = read_limits(Path::new("/nowhere/limits.toml")).unwrap_err();
        assert_eq!(missing.exit_status(), 74);
    }
}
