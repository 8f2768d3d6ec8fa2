//! Effect of a calibration on a simulated robot.

use fleetcal_model::RobotTime;
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::CalibrationValues;
use fleetcal_proto::signing::TrustedKeys;

use crate::agent::{Agent, Held, Identity, Limits, Memory};
use crate::simulator::{Applied, Pose2};

/// Largest distance of a LiDAR from its drawing, m and rad.
const MOUNT_POSITION_MAX_M: f64 = 0.5;
const MOUNT_YAW_MAX_RAD: f64 = 0.5;

/// Makes the agent of a robot that drives with its drawing.
pub(super) fn agent(
    robot: RobotId,
    trusted: TrustedKeys,
    nominal: Applied,
    now: RobotTime,
) -> Agent {
    let Pose2 { x_m, y_m, yaw_rad } = nominal.lidar_in_base;
    let (most_m, most_rad) = (MOUNT_POSITION_MAX_M, MOUNT_YAW_MAX_RAD);
    let limits = Limits::around_mount(x_m, y_m, yaw_rad, most_m, most_rad);
    let held = Held::factory(Some(values_of(nominal)), now);
    let memory = Memory::new(robot.clone(), held);
    let identity = Identity {
        robot,
        trusted,
        limits,
    };
    Agent::new(identity, memory)
}

/// Selects the values that the simulation drives with: a simulated robot corrects nothing else.
pub(super) fn applied_of(values: &CalibrationValues) -> Applied {
    Applied {
        steering_offset_rad: values.steering_offset_rad,
        lidar_in_base: Pose2::new(values.lidar_x_m, values.lidar_y_m, values.lidar_yaw_rad),
    }
}

fn values_of(applied: Applied) -> CalibrationValues {
    let Pose2 { x_m, y_m, yaw_rad } = applied.lidar_in_base;
    CalibrationValues {
        steering_offset_rad: applied.steering_offset_rad,
        lidar_x_m: x_m,
        lidar_y_m: y_m,
        lidar_yaw_rad: yaw_rad,
        ..CalibrationValues::default()
    }
}
