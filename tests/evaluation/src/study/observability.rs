//! Study 6d: what each manoeuvre tells, and an advisor that says which one a robot should drive.

use fleetcal_estimator::advice::Knowledge;
use fleetcal_estimator::advice::manoeuvre::{Manoeuvre, library};
use fleetcal_estimator::advice::ranking::{Ranked, information_bits, rank};
use fleetcal_estimator::filter::{ParameterCovariance, Values};
use fleetcal_estimator::vehicle::{DriveParameters, SteeringCurve, SteeringResponse};
use fleetcal_estimator::{Parameter, Vehicle, VehicleModel};
use rayon::prelude::*;

use super::first_choice;
use crate::drive::estimators_pose;
use crate::error::EvaluationError;
use crate::extent::Extent;
use crate::report::{Section, Table};
use crate::robots::{TUGGER_CAD, mount};
use crate::scripted::{Scripted, Truth};
use crate::statistics::mean;

/// Shown quantities of each manoeuvre: parameter, heading, factor from SI.
const SHOWN: [(Parameter, &str, f64); 6] = [
    (Parameter::LidarX, "x, mm", 1e3),
    (Parameter::LidarY, "y, mm", 1e3),
    (Parameter::LidarYaw, "yaw, °", 180.0 / std::f64::consts::PI),
    (
        Parameter::SteeringOffset,
        "steering, °",
        180.0 / std::f64::consts::PI,
    ),
    (Parameter::SpeedScale, "speed scale, %", 1e2),
    (Parameter::TimeOffset, "delay, ms", 1e3),
];
/// Distance that the advisor assumes for getting to a manoeuvre, m, as in its own ranking.
const APPROACH_M: f64 = 5.0;
/// Manoeuvres that a robot may have driven before it queries the advisor.
const PASTS: [(&str, &[&str]); 5] = [
    ("nothing yet", &[]),
    ("30 m straight", &["straight", "straight", "straight"]),
    ("two left circles", &["left_circle", "left_circle"]),
    ("a left and a right turn", &["left_turn", "right_turn"]),
    ("two figure-eights", &["figure_eight", "figure_eight"]),
];

/// One manoeuvre driven: information gained, bits for each metre of way.
struct Driven {
    name: &'static str,
    bits: f64,
    bits_per_m: f64,
}

/// Runs the study.
///
/// # Errors
/// The error of a run.
pub fn study(extent: &Extent) -> Result<Section, EvaluationError> {
    let mut section = Section::new("6d. What each manoeuvre tells, and which to drive next");
    section.words(
        "A tugger that knows its mount from CAD (±0.1 m, ±5.7°) and nothing else drives one manoeuvre \
         of the advisor's library, once. The table has the standard deviations that the advisor \
         foretells and, behind the stroke, those of the filter after it was really driven (LiDAR \
         poses of 3 mm and 0.03°, an encoder of 0.25°, mean over the seeds).",
    );
    section.table(map(extent)?);
    section.words(
        "The advisor ranks the library by the uncertainty that each manoeuvre would remove from \
         parameters which are not `converged` yet, for each metre of way (5 m to get there included), \
         among those that fit on the floor. To prove it, robots with different pasts drive its first \
         choice, and for comparison every other manoeuvre from the same state. *Information* is \
         `log2(det P / det \
         P') / 2` over the estimated parameters, by the filter that drove it; the rank is that of the \
         first choice in information for each metre, as it came out.",
    );
    let mut table = Table::new(&[
        "driven before",
        "first choice",
        "floor, m",
        "foretold, bits",
        "gained, bits",
        "rank",
        "share of the best",
    ]);
    let mut least = f64::INFINITY;
    for (past, names) in PASTS {
        least = least.min(proof(extent, past, names, &mut table)?);
    }
    section.table(table);
    first_choice::add(extent, &mut section)?;
    section.at_least(
        "information for each metre of the advisor's first choice, of the best there was",
        least,
        // With the steering's curve estimated too; 0.8 without.
        0.7,
        |share| format!("{:.0} %", 100.0 * share),
    );
    Ok(section)
}

fn robot(seed: u64) -> Scripted {
    let vehicle = Vehicle::new(VehicleModel::Bicycle, 1.2);
    let truth = Truth {
        parameters: DriveParameters {
            steering_offset_rad: 0.92_f64.to_radians(),
            speed_scale: 1.005,
            wheelbase_m: 1.2,
            steering_gain: 1.0,
            side_slip_rad_per_mps2: 0.0,
            curve: SteeringCurve::default(),
            response: SteeringResponse::default(),
            half_play_rad: 0.0,
        },
        time_offset_s: 0.02,
        lidar_in_base: estimators_pose(&mount(0.43, 0.0046, 0.72)),
    };
    Scripted::new(seed, vehicle, truth, TUGGER_CAD)
}

fn advised(robot: &Scripted) -> Vec<Ranked> {
    let (vehicle, settings) = robot.known();
    rank(
        &Knowledge {
            vehicle,
            values: robot.filter().values(),
            covariance: &robot.filter().parameter_covariance(),
            settings,
        },
        None,
    )
}

fn driven(robot: &Scripted, manoeuvre: &Manoeuvre) -> Result<Scripted, EvaluationError> {
    let mut robot = robot.clone();
    let (vehicle, _) = robot.known();
    let readings = manoeuvre.readings(vehicle);
    robot.drive(&readings)?;
    Ok(robot)
}

fn sigma(covariance: &ParameterCovariance) -> Values {
    Values::from_fn(|i, _| covariance[(i, i)].sqrt())
}

/// Makes the table of predicted and real standard deviations after each manoeuvre from nothing.
fn map(extent: &Extent) -> Result<Table, EvaluationError> {
    let mut header = vec!["manoeuvre", "way, m", "floor, m"];
    header.extend(SHOWN.map(|(_, heading, _)| heading));
    let mut table = Table::new(&header);
    let start = robot(1);
    let (vehicle, _) = start.known();
    let foretold = advised(&start);
    for manoeuvre in library(vehicle) {
        let each = |&seed: &u64| {
            let after = driven(&robot(seed), &manoeuvre)?;
            Ok(sigma(&after.filter().parameter_covariance()))
        };
        let sigmas: Result<Vec<_>, EvaluationError> = extent.seeds().par_iter().map(each).collect();
        let sigmas = sigmas?;
        let advice = foretold.iter().map(|ranked| &ranked.advice);
        let mut matching = advice.filter(|advice| advice.manoeuvre.name == manoeuvre.name);
        let foretold = matching.next().map(|advice| advice.sigma_after);
        let mut row = vec![
            manoeuvre.name.to_owned(),
            format!("{:.0}", manoeuvre.distance_m()),
            floor(&manoeuvre),
        ];
        row.extend(SHOWN.map(|(parameter, _, factor)| {
            let i = parameter.index();
            let real: Vec<_> = sigmas.iter().map(|sigma| factor * sigma[i]).collect();
            let foretold = foretold.map_or(f64::NAN, |sigma| factor * sigma[i]);
            format!("{} / {}", short(foretold), short(mean(&real)))
        }));
        table.row(row);
    }
    Ok(table)
}

/// Drives all manoeuvres after a past and returns the advisor's first choice's share of the best
/// one's information for each metre.
fn proof(
    extent: &Extent,
    past: &str,
    names: &[&str],
    table: &mut Table,
) -> Result<f64, EvaluationError> {
    let begin = |seed: u64| {
        let mut begun = robot(seed);
        let (vehicle, _) = begun.known();
        let library = library(vehicle);
        for name in names {
            let found = library.iter().filter(|manoeuvre| manoeuvre.name == *name);
            for manoeuvre in found {
                begun = driven(&begun, manoeuvre)?;
            }
        }
        Ok::<_, EvaluationError>(begun)
    };
    let ranked = advised(&begin(1)?);
    let Some(first) = ranked.first() else {
        return Ok(0.0);
    };
    let mut gains = Vec::new();
    for Ranked { advice, .. } in &ranked {
        let each = |&seed: &u64| {
            let before = begin(seed)?;
            let after = driven(&before, &advice.manoeuvre)?;
            let (_, settings) = after.known();
            Ok(information_bits(
                &before.filter().parameter_covariance(),
                &after.filter().parameter_covariance(),
                settings,
            ))
        };
        let bits: Result<Vec<_>, EvaluationError> = extent.seeds().par_iter().map(each).collect();
        let bits = mean(&bits?);
        gains.push(Driven {
            name: advice.manoeuvre.name,
            bits,
            bits_per_m: bits / (APPROACH_M + advice.manoeuvre.distance_m()),
        });
    }
    gains.sort_by(|a, b| b.bits_per_m.total_cmp(&a.bits_per_m));
    let name = first.advice.manoeuvre.name;
    let place = gains.iter().position(|gain| gain.name == name);
    let place = place.unwrap_or_default();
    let share = gains[place].bits_per_m / gains[0].bits_per_m;
    table.row([
        past.to_owned(),
        name.to_owned(),
        floor(&first.advice.manoeuvre),
        format!("{:.1}", first.information_bits),
        format!("{:.1}", gains[place].bits),
        format!("{} of {}", place + 1, gains.len()),
        format!("{:.0} %", 100.0 * share),
    ]);
    Ok(share)
}

fn floor(manoeuvre: &Manoeuvre) -> String {
    let [long, wide] = manoeuvre.space_m;
    format!("{long:.1} × {wide:.1}")
}

/// Formats two significant digits.
fn short(value: f64) -> String {
    if value >= 10.0 {
        format!("{value:.0}")
    } else if value >= 1.0 {
        format!("{value:.1}")
    } else if value >= 0.1 {
        format!("{value:.2}")
    } else {
        format!("{value:.3}")
    }
}
