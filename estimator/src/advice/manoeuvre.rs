//! A library of manoeuvres that a driver, or a fleet's dispatcher, can order from a robot.

use crate::drive_history::DriveSegment;
use crate::vehicle::{DriveReading, SpeedMeasuredAt, Vehicle};

/// Steering angle of a manoeuvre's turns: every vehicle can do it, rad (20 degrees).
const TURN_STEERING_RAD: f64 = 0.35;
/// Steering angle of a slalom, rad (6 degrees).
const SLALOM_STEERING_RAD: f64 = 0.1;
/// Speed of a manoeuvre, m/s.
const SPEED_MPS: f64 = 0.8;
/// Time between two readings, s.
const STEP_S: f64 = 0.05;

/// A stretch of a manoeuvre: a steering angle held over a distance, at a speed.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Leg {
    steering_rad: f64,
    distance_m: f64,
    from_mps: f64,
    to_mps: f64,
}

/// Manoeuvre that can be driven.
#[derive(Debug, Clone, PartialEq)]
pub struct Manoeuvre {
    /// Short name: `left_turn`.
    pub name: &'static str,
    /// Instruction to a driver.
    pub instruction: String,
    /// Length and width of the floor it needs, m.
    pub space_m: [f64; 2],
    legs: Vec<Leg>,
}

impl Manoeuvre {
    /// Distance driven, m.
    pub fn distance_m(&self) -> f64 {
        self.legs.iter().map(|leg| leg.distance_m).sum()
    }

    /// The drive readings of a vehicle without errors that drives it.
    pub fn readings(&self, vehicle: &Vehicle) -> Vec<DriveSegment> {
        let mut readings = Vec::new();
        for leg in &self.legs {
            let (mut driven_m, mut before_mps) = (0.0, None);
            while driven_m < leg.distance_m {
                let share = driven_m / leg.distance_m;
                let rear_mps = leg.from_mps + (leg.to_mps - leg.from_mps) * share;
                driven_m += rear_mps.abs().max(0.05) * STEP_S;
                let speed_mps = measured_mps(vehicle, rear_mps, leg.steering_rad);
                readings.push(DriveSegment {
                    duration_s: STEP_S,
                    drive: DriveReading {
                        speed_mps,
                        speed_rate_mps2: before_mps
                            .map_or(0.0, |before| (speed_mps - before) / STEP_S),
                        steering_rad: leg.steering_rad,
                        ..DriveReading::default()
                    },
                    held_m: 0.0,
                    steering_step_rad: 0.0,
                });
                before_mps = Some(speed_mps);
            }
        }
        readings
    }
}

fn measured_mps(vehicle: &Vehicle, rear_mps: f64, steering_rad: f64) -> f64 {
    match vehicle.speed_measured_at {
        SpeedMeasuredAt::RearAxle => rear_mps,
        SpeedMeasuredAt::SteeredWheel => rear_mps / steering_rad.cos(),
        SpeedMeasuredAt::RearWheel { lateral_m } => {
            rear_mps * (1.0 - lateral_m * steering_rad.tan() / vehicle.wheelbase_m)
        }
    }
}

/// All manoeuvres, sized for a vehicle.
pub fn library(vehicle: &Vehicle) -> Vec<Manoeuvre> {
    let radius_m = vehicle.wheelbase_m / TURN_STEERING_RAD.tan();
    let quarter_m = std::f64::consts::FRAC_PI_2 * radius_m;
    let full_m = 4.0 * quarter_m;
    let turn = |side: f64, distance_m: f64| leg(side * TURN_STEERING_RAD, distance_m);
    let sway = |side: f64| leg(side * SLALOM_STEERING_RAD, 2.0);
    let around_m = 2.0 * radius_m;
    let tight = format!("with a radius of about {radius_m:.1} m");
    vec![
        manoeuvre(
            "straight",
            "10 m straight ahead",
            [10.0, 1.0],
            vec![leg(0.0, 10.0)],
        ),
        manoeuvre(
            "left_turn",
            &format!("a quarter turn to the left {tight}"),
            [radius_m + 2.0, radius_m + 2.0],
            vec![leg(0.0, 2.0), turn(1.0, quarter_m), leg(0.0, 2.0)],
        ),
        manoeuvre(
            "right_turn",
            &format!("a quarter turn to the right {tight}"),
            [radius_m + 2.0, radius_m + 2.0],
            vec![leg(0.0, 2.0), turn(-1.0, quarter_m), leg(0.0, 2.0)],
        ),
        manoeuvre(
            "left_circle",
            &format!("a full circle to the left {tight}"),
            [around_m, around_m],
            vec![turn(1.0, full_m)],
        ),
        manoeuvre(
            "s_curve",
            &format!("a left and a right quarter turn {tight}"),
            [around_m, around_m],
            vec![turn(1.0, quarter_m), turn(-1.0, quarter_m)],
        ),
        manoeuvre(
            "figure_eight",
            &format!("a figure-eight {tight}"),
            [2.0 * around_m, around_m],
            vec![turn(1.0, full_m), turn(-1.0, full_m)],
        ),
        manoeuvre(
            "slalom",
            "16 m of slalom",
            [16.0, 2.0],
            (0..8)
                .map(|i| sway(if i % 2 == 0 { 1.0 } else { -1.0 }))
                .collect(),
        ),
        manoeuvre(
            "stop_and_go",
            "two stops on 8 m straight ahead",
            [8.0, 1.0],
            vec![
                pace(0.1, 1.2),
                pace(1.2, 0.1),
                pace(0.1, 1.2),
                pace(1.2, 0.1),
            ],
        ),
        manoeuvre(
            "reverse",
            "5 m backwards and 5 m forwards",
            [5.0, 1.0],
            vec![back(5.0), leg(0.0, 5.0)],
        ),
    ]
}

fn manoeuvre(
    name: &'static str,
    instruction: &str,
    space_m: [f64; 2],
    legs: Vec<Leg>,
) -> Manoeuvre {
    Manoeuvre {
        name,
        instruction: instruction.to_owned(),
        space_m,
        legs,
    }
}

fn leg(steering_rad: f64, distance_m: f64) -> Leg {
    Leg {
        steering_rad,
        distance_m,
        from_mps: SPEED_MPS,
        to_mps: SPEED_MPS,
    }
}

fn back(distance_m: f64) -> Leg {
    Leg {
        steering_rad: 0.0,
        distance_m,
        from_mps: -SPEED_MPS,
        to_mps: -SPEED_MPS,
    }
}

fn pace(from_mps: f64, to_mps: f64) -> Leg {
    Leg {
        steering_rad: 0.0,
        distance_m: 2.0,
        from_mps,
        to_mps,
    }
}
