//! A library of manoeuvres that a driver, or a fleet's dispatcher, can order from a robot.

use nalgebra::Vector3;

use crate::Pose2;
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
/// Largest distance between two poses of a path, m: chords of the turns are a centimetre off.
const PATH_STEP_M: f64 = 0.5;

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

    /// Time that a vehicle without errors takes for it, s.
    pub fn duration_s(&self, vehicle: &Vehicle) -> f64 {
        let readings = self.readings(vehicle);
        readings.iter().map(|reading| reading.duration_s).sum()
    }

    /// Poses of the rear axle along it, in the frame of the first, of a vehicle without errors.
    pub fn path(&self, vehicle: &Vehicle) -> Vec<Pose2> {
        let mut begin = Pose2::IDENTITY;
        let mut poses = vec![begin];
        for leg in &self.legs {
            let along_m = leg.distance_m.copysign(leg.from_mps);
            let yaw_rad = along_m * leg.steering_rad.tan() / vehicle.wheelbase_m;
            let whole = Vector3::new(along_m, 0.0, yaw_rad);
            let steps = (leg.distance_m / PATH_STEP_M).ceil();
            let mut step = 0.0;
            while step < steps {
                step += 1.0;
                poses.push(begin.compose(&Pose2::exp(&(whole * (step / steps)))));
            }
            begin = begin.compose(&Pose2::exp(&whole));
        }
        poses
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
                        steering_rad: vehicle.model.steered_ahead() * leg.steering_rad,
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle::VehicleModel;

    #[test]
    fn a_path_is_as_long_as_its_manoeuvre_and_fits_on_its_floor() {
        let vehicle = Vehicle::new(VehicleModel::Bicycle, 1.2);
        for manoeuvre in library(&vehicle) {
            let path = manoeuvre.path(&vehicle);
            let length_m: f64 = path
                .windows(2)
                .map(|pair| pair[0].point().distance_m(pair[1].point()))
                .sum();
            let distance_m = manoeuvre.distance_m();
            assert!(
                (length_m / distance_m - 1.0).abs() < 0.01,
                "{}: {length_m} of {distance_m}",
                manoeuvre.name
            );
            let side_m = |of: fn(&Pose2) -> f64| {
                let (low, high) = path.iter().map(of).fold((0.0, 0.0), |(low, high), m| {
                    (f64::min(low, m), f64::max(high, m))
                });
                high - low
            };
            let mut sides_m = [side_m(|pose| pose.x_m), side_m(|pose| pose.y_m)];
            sides_m.sort_by(f64::total_cmp);
            let mut space_m = manoeuvre.space_m;
            space_m.sort_by(f64::total_cmp);
            let fits = (0..2).all(|i| sides_m[i] <= space_m[i] + 0.01);
            assert!(fits, "{}: {sides_m:?} on {space_m:?}", manoeuvre.name);
        }
    }

    #[test]
    fn a_left_turn_ends_to_the_left_and_backing_ends_where_it_began() {
        let vehicle = Vehicle::new(VehicleModel::Bicycle, 1.2);
        let end = |name: &str| {
            let manoeuvre = library(&vehicle).into_iter().find(|one| one.name == name);
            let path = manoeuvre.unwrap().path(&vehicle);
            *path.last().unwrap()
        };
        let left = end("left_turn");
        assert!((left.yaw_rad.to_degrees() - 90.0).abs() < 0.1, "{left:?}");
        assert!(left.y_m > 5.0, "{left:?}");
        assert!((end("right_turn").yaw_rad.to_degrees() + 90.0).abs() < 0.1);
        let reverse = end("reverse");
        assert!(reverse.x_m.abs() < 1e-9, "{reverse:?}");
    }

    #[test]
    fn a_manoeuvre_takes_as_long_as_its_speeds_say() {
        let vehicle = Vehicle::new(VehicleModel::Bicycle, 1.2);
        let manoeuvres = library(&vehicle);
        let straight = manoeuvres.iter().find(|one| one.name == "straight");
        let duration_s = straight.unwrap().duration_s(&vehicle);
        assert!((duration_s - 10.0 / SPEED_MPS).abs() < 0.1, "{duration_s}");
    }
}
