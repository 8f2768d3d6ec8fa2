//! The robots whose data both filters are given.

use fleetcal_estimator::geometry::Pose2;
use fleetcal_robot::simulator::{Change, ScheduledChange, Slip};

use crate::drive::Robot;
use crate::robots::{NANO_CAD, TUGGER_CAD, laden, mount, nano, tugger};

/// One row: a robot, and the start of both filters (`None`: from nothing).
pub struct Row {
    /// Description of the data.
    pub name: &'static str,
    /// Nominal mount for both filters.
    pub nominal: Option<Pose2>,
    /// Robot of a seed; its events happen at the given time, s.
    pub robot: fn(u64, f64) -> Robot,
}

/// Returns all rows.
pub fn rows() -> Vec<Row> {
    vec![
        Row {
            name: "a robot without anything its model leaves out, from CAD",
            nominal: Some(TUGGER_CAD),
            robot: ideal,
        },
        Row {
            name: "the same from zero",
            nominal: None,
            robot: ideal,
        },
        Row {
            name: "unladen tugger, from CAD",
            nominal: Some(TUGGER_CAD),
            robot: unladen,
        },
        Row {
            name: "laden tugger, from CAD",
            nominal: Some(TUGGER_CAD),
            robot: |seed, _| laden(unladen(seed, 0.0)),
        },
        Row {
            name: "induced −9°, from CAD",
            nominal: Some(TUGGER_CAD),
            robot: |seed, _| tugger(seed, mount(0.43, 0.0046, 0.72), -9.0),
        },
        Row {
            name: "nano, from CAD",
            nominal: Some(NANO_CAD),
            robot: |seed, _| nano(seed, mount(0.2597, 0.0101, -1.29), -1.11),
        },
        Row {
            name: "LiDAR knocked by 20 mm and 1°",
            nominal: Some(TUGGER_CAD),
            robot: knocked,
        },
        Row {
            name: "steering zero jumps by 2°",
            nominal: Some(TUGGER_CAD),
            robot: jumped,
        },
        Row {
            name: "LiDAR that looks backwards, from zero",
            nominal: None,
            robot: backwards,
        },
    ]
}

/// Makes a robot that obeys the paper's assumptions: no slip, no late stream, wheels as configured.
fn ideal(seed: u64, half_s: f64) -> Robot {
    let mut robot = unladen(seed, half_s);
    let vehicle = &mut robot.simulation.vehicle;
    vehicle.speed_scale = 1.0;
    vehicle.time_offset_s = 0.0;
    vehicle.slip = Slip::default();
    robot
}

fn unladen(seed: u64, _: f64) -> Robot {
    tugger(seed, mount(0.43, 0.0046, 0.72), 0.92)
}

/// Makes a robot that localises well, while its calibrator does not know the LiDAR's pose.
fn backwards(seed: u64, _: f64) -> Robot {
    let mut robot = tugger(seed, mount(-0.3, 0.2, 170.0), 0.92);
    robot.simulation.applied.lidar_in_base = robot.simulation.vehicle.lidar_in_base;
    robot
}

fn knocked(seed: u64, half_s: f64) -> Robot {
    changed(seed, half_s, Change::Mount(mount(0.02, 0.0, 1.0)))
}

fn jumped(seed: u64, half_s: f64) -> Robot {
    changed(seed, half_s, Change::SteeringOffset(2f64.to_radians()))
}

fn changed(seed: u64, at_s: f64, change: Change) -> Robot {
    let mut robot = unladen(seed, at_s);
    robot.simulation.changes = vec![ScheduledChange { at_s, change }];
    robot
}
