//! Steps that are put into recordings of real robots, and their parts without any.

use std::path::Path;

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::{
    Calibrator, DriveSample, Effect, Estimate, Event, LidarPose, Parameter, Pose2,
};
use fleetcal_evaluation::stuck::Outcome;
use rayon::prelude::*;

use super::Failure;
use super::recorded::{self, each_event};

/// A step of a value.
#[derive(Debug, Clone, Copy)]
struct Step {
    name: &'static str,
    steering_rad: f64,
    lidar: Pose2,
}

const fn step(name: &'static str, steering_rad: f64, yaw_rad: f64) -> Step {
    Step {
        name,
        steering_rad,
        lidar: Pose2::new(0.0, 0.0, yaw_rad),
    }
}

const DEG: f64 = std::f64::consts::PI / 180.0;
const STEPS: [Step; 10] = [
    step("steering +1", DEG, 0.0),
    step("steering -1", -DEG, 0.0),
    step("steering +2", 2.0 * DEG, 0.0),
    step("steering -2", -2.0 * DEG, 0.0),
    step("steering +5", 5.0 * DEG, 0.0),
    step("steering -5", -5.0 * DEG, 0.0),
    step("yaw +1", 0.0, DEG),
    step("yaw -1", 0.0, -DEG),
    step("yaw +3", 0.0, 3.0 * DEG),
    step("yaw -3", 0.0, -3.0 * DEG),
];
/// Shares of a recording after which a step happens.
const SHARES: [f64; 2] = [0.35, 0.5];

type Outcomes = Vec<(String, Outcome)>;

/// Outcomes with steps, and of parts without.
pub fn drive(data: &Path) -> Result<(Outcomes, Outcomes), Failure> {
    let (mut stepped, mut parts) = (Vec::new(), Vec::new());
    for drive in recorded::of(data) {
        if !["sapienza_tricycle", "dart_right"].contains(&drive.name()) {
            continue;
        }
        let config = CalibratorConfig::of(drive.vehicle().ok_or("no vehicle")?);
        let mut events = Vec::new();
        each_event(&drive.open()?, |event| events.push(event))?;
        let unchanged = calibrated(&config, &events, None, None);
        let reference = unchanged.1.ok_or("no estimate")?;
        let cases: Vec<_> = STEPS
            .iter()
            .flat_map(|step| SHARES.map(|share| (*step, share)))
            .collect();
        let runs = cases.par_iter().map(|(step, share)| {
            let at = events.len() * (share * 100.0) as usize / 100;
            let name = format!("{} {} at {share}", drive.name(), step.name);
            let (outcome, _) = calibrated(&config, &events, Some((*step, at)), Some(&reference));
            (name, outcome)
        });
        stepped.extend(runs.collect::<Vec<_>>());
        for (name, from, to) in [
            ("whole", 0.0, 1.0),
            ("first half", 0.0, 0.5),
            ("second half", 0.5, 1.0),
            ("middle", 0.25, 0.75),
        ] {
            let at = |share: f64| (events.len() as f64 * share) as usize;
            let part = events.get(at(from)..at(to)).unwrap_or_default();
            let (outcome, _) = calibrated(&config, part, None, Some(&reference));
            parts.push((format!("{} {name}", drive.name()), outcome));
        }
    }
    Ok((stepped, parts))
}

fn moved(event: &Event, step: &Step) -> Event {
    match event {
        Event::WheelOdometry(sample) => {
            let steering_rad = sample.steering_rad() + step.steering_rad;
            let moved = DriveSample::new(sample.stamp(), sample.speed_mps(), steering_rad);
            Event::WheelOdometry(moved.unwrap_or(*sample))
        }
        Event::LidarPose(pose) => {
            let at = pose.pose().compose(&step.lidar);
            let moved = LidarPose::new(pose.stamp(), at, pose.covariance().copied());
            moved.map_or_else(|_| event.clone(), Event::LidarPose)
        }
        other => other.clone(),
    }
}

fn calibrated(
    config: &CalibratorConfig,
    events: &[Event],
    step: Option<(Step, usize)>,
    reference: Option<&Estimate>,
) -> (Outcome, Option<Estimate>) {
    let mut calibrator = Calibrator::new(config.clone());
    let (mut outcome, mut last) = (Outcome::default(), None);
    let end = std::iter::once(Event::EndOfSession);
    for (i, event) in events.iter().cloned().chain(end).enumerate() {
        let of = step.filter(|(_, at)| i >= *at).map(|(step, _)| step);
        let event = of.map_or_else(|| event.clone(), |step| moved(&event, &step));
        for effect in calibrator.step(event) {
            match effect {
                Effect::Estimate(estimate) => {
                    let error = |p: Parameter| {
                        let by = match (p, of) {
                            (Parameter::SteeringOffset, Some(step)) => step.steering_rad,
                            (Parameter::LidarYaw, Some(step)) => step.lidar.yaw_rad,
                            _ => 0.0,
                        };
                        reference.map_or(0.0, |reference| {
                            estimate.parameter(p).value - reference.parameter(p).value - by
                        })
                    };
                    outcome.see(&estimate, error, of.is_some());
                    last = Some(*estimate);
                }
                Effect::Change(change) => {
                    let distance_m = last.as_ref().map_or(0.0, |last| last.distance_m);
                    outcome.flag(&change, distance_m);
                }
                _ => {}
            }
        }
    }
    (outcome, last)
}
