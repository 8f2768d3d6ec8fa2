//! Study 6a: continuous correction in the controller, and whether that is stable.

use std::ops::ControlFlow;

use fleetcal_estimator::{Estimate, Parameter, Status};
use fleetcal_robot::simulator::{Applied, Change, ScheduledChange, Simulation};
use rayon::prelude::*;

use super::cases::last;
use crate::drive::{CrossTrack, FOUR, Robot, Seen, drive_watched, error_of};
use crate::error::EvaluationError;
use crate::extent::Extent;
use crate::paper::RUN_SETS;
use crate::plot::{BLUE_LINE, GREEN_LINE, GREY_LINE, ORANGE_LINE, Panel, Points, Series, figure};
use crate::report::{Section, Table};
use crate::robots::{WAREHOUSE_LOCALISATION, mount, tugger};
use crate::statistics::{largest, rms, spread};

/// Size of the jump of the steering zero, degrees.
const JUMP_DEG: f64 = 1.5;
/// Delay of a late correction, s.
const LATE_S: f64 = 10.0;

/// Policy by which the robot applies its estimates.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Policy {
    /// Nothing is applied: the loop is open.
    Nothing,
    /// Every value of every estimate is applied, once a second, known or not.
    Everything,
    /// Converged values are applied, once a second.
    Converged,
    /// Converged values are applied, ten seconds late.
    ConvergedLate,
    /// The truth is applied.
    Truth,
}

const POLICIES: [(Policy, &str); 5] = [
    (Policy::Nothing, "corrects nothing"),
    (Policy::Everything, "applies every estimate at once"),
    (Policy::Converged, "applies what is `converged`"),
    (Policy::ConvergedLate, "the same, 10 s late"),
    (Policy::Truth, "is told the truth"),
];
/// Index of the open loop among them.
const OPEN: usize = 0;
/// Index of the usual policy.
const USUAL: usize = 2;
/// Index of the truth.
const TOLD: usize = 4;
/// Indices of the policies with feedback.
const CLOSED: [usize; 3] = [1, USUAL, 3];
const NOT_CLOSED: [usize; 2] = [OPEN, TOLD];

/// One drive with one policy.
#[derive(Debug, Clone, Default)]
struct Looped {
    /// Cross-track errors once settled, and after the jump, m.
    settled_m: Vec<f64>,
    after_jump_m: Vec<f64>,
    /// Applied minus true steering offset over time: s, degrees.
    applied: Points,
    /// The four estimates' errors at the end, m, m, rad, rad.
    errors: [f64; 4],
}

/// Runs the study.
///
/// # Errors
/// The error of a run or a figure.
pub fn study(extent: &Extent) -> Result<Section, EvaluationError> {
    let stretch_s = extent.loop_stretch_s;
    let mut section = Section::new("6a. Continuous correction in the controller");
    section.words(format!(
        "The paper corrects by hand, between runs. Here the controller takes the estimates while it \
         drives: a tugger of run set 3 (2.92° off, its mount known from CAD alone) starts cold, and \
         after {:.0} s its steering zero jumps by {JUMP_DEG}°. The estimator always sees the raw \
         steering, so what is applied comes back to it only as another way driven: there is no loop \
         that could ring. The proof is in the numbers: the applied offset stands still, and the \
         estimates with the loop closed are as good as with it open.",
        2.0 * stretch_s
    ));
    let seeds = extent.seeds();
    let mut all = Vec::new();
    for (policy, _) in POLICIES {
        let each = |&seed: &u64| looped(extent, policy, seed);
        let runs: Result<Vec<_>, EvaluationError> = seeds.par_iter().map(each).collect();
        all.push(runs?);
    }
    section.table(table(&all, stretch_s));
    section.figure(figure(
        "closed_loop",
        "Applied less true steering offset, all seeds: every estimate at once (grey), what is \
         converged (blue), the same 10 s late (orange). Right: the same from near",
        2,
        &[panel(&all, stretch_s, 4.0), panel(&all, stretch_s, 0.1)],
    )?);
    claims(&mut section, &all);
    Ok(section)
}

fn claims(section: &mut Section, all: &[Vec<Looped>]) {
    let apart = settled_rmse_m(&all[USUAL]) / settled_rmse_m(&all[TOLD]) - 1.0;
    section.at_most(
        "cross-track RMSE in closed loop against perfectly calibrated",
        apart,
        0.05,
        |apart| format!("{:+.2} %", 100.0 * apart),
    );
    let still_deg = all[USUAL].iter().map(|run| spread(&settled_applied(run)));
    section.at_most(
        "wandering of the applied steering offset once settled (standard deviation)",
        still_deg.fold(0.0, f64::max),
        0.01,
        |deg| format!("{deg:.4}°"),
    );
    // Together: of two seeds alone, each policy's error is known to a factor of two.
    let steering_deg = |policies: &[usize]| {
        let runs = policies.iter().flat_map(|&policy| &all[policy]);
        rms(&runs.map(|run| run.errors[3]).collect::<Vec<_>>()).to_degrees()
    };
    section.at_most(
        "steering RMSE at the end, loop closed over loop open",
        steering_deg(&CLOSED) / steering_deg(&NOT_CLOSED),
        2.0,
        |ratio| format!("{ratio:.2} times"),
    );
}

fn robot(seed: u64, jump_at_s: f64) -> Robot {
    let [x_m, y_m, yaw_deg, offset_deg] = RUN_SETS[2].calibrated;
    let mut robot = tugger(seed, mount(x_m, y_m, yaw_deg), offset_deg);
    robot.simulation.localisation = WAREHOUSE_LOCALISATION;
    robot.simulation.changes = vec![ScheduledChange {
        at_s: jump_at_s,
        change: Change::SteeringOffset(JUMP_DEG.to_radians()),
    }];
    robot
}

fn looped(extent: &Extent, policy: Policy, seed: u64) -> Result<Looped, EvaluationError> {
    let stretch_s = extent.loop_stretch_s;
    let mut seen_so_far = Looped::default();
    let (mut settled, mut after_jump) = (CrossTrack::default(), CrossTrack::default());
    // What is to be applied, and when.
    let mut due: Vec<(f64, Applied)> = Vec::new();
    let run = drive_watched(
        robot(seed, 2.0 * stretch_s),
        3.0 * stretch_s,
        |time_s, seen, robot| {
            if policy == Policy::Truth {
                robot.set_applied(truth(robot));
            }
            match seen {
                Seen::Message(emitted, _) => {
                    if (stretch_s..2.0 * stretch_s).contains(&time_s) {
                        settled.see(emitted);
                    } else if time_s > 2.5 * stretch_s {
                        after_jump.see(emitted);
                    }
                }
                Seen::Estimate(estimate, _) => {
                    let latest = due.last().map_or(robot.applied(), |(_, applied)| *applied);
                    due.extend(correction(policy, estimate, latest, time_s));
                    while due.first().is_some_and(|(at_s, _)| *at_s <= time_s) {
                        robot.set_applied(due.remove(0).1);
                    }
                    let off_rad = robot.applied().steering_offset_rad
                        - robot.parameters().steering_offset_rad;
                    seen_so_far.applied.push((time_s, off_rad.to_degrees()));
                }
            }
            ControlFlow::Continue(())
        },
    )?;
    let (estimate, truth) = last("closed loop", seed, &run)?;
    Ok(Looped {
        settled_m: settled.values_m,
        after_jump_m: after_jump.values_m,
        errors: FOUR.map(|p| error_of(p, estimate.parameter(p).value, truth)),
        ..seen_so_far
    })
}

fn truth(robot: &Simulation) -> Applied {
    let truth = robot.parameters();
    Applied {
        steering_offset_rad: truth.steering_offset_rad,
        lidar_in_base: truth.lidar_in_base,
    }
}

/// Returns the correction that a policy derives from an estimate, with the time at which it is
/// applied (s).
fn correction(
    policy: Policy,
    estimate: &Estimate,
    latest: Applied,
    time_s: f64,
) -> Option<(f64, Applied)> {
    let (only_converged, late_s) = match policy {
        Policy::Nothing | Policy::Truth => return None,
        Policy::Everything => (false, 0.0),
        Policy::Converged => (true, 0.0),
        Policy::ConvergedLate => (true, LATE_S),
    };
    let mut applied = latest;
    for (parameter, value) in [
        (Parameter::SteeringOffset, &mut applied.steering_offset_rad),
        (Parameter::LidarX, &mut applied.lidar_in_base.x_m),
        (Parameter::LidarY, &mut applied.lidar_in_base.y_m),
        (Parameter::LidarYaw, &mut applied.lidar_in_base.yaw_rad),
    ] {
        let found = estimate.parameter(parameter);
        if found.status == Status::Converged || !only_converged {
            *value = found.value;
        }
    }
    Some((time_s + late_s, applied))
}

fn settled_rmse_m(runs: &[Looped]) -> f64 {
    rms(&runs
        .iter()
        .flat_map(|run| run.settled_m.clone())
        .collect::<Vec<_>>())
}

/// Returns the applied minus the true steering offset in the second stretch, degrees.
fn settled_applied(run: &Looped) -> Vec<f64> {
    let third = run.applied.len() / 3;
    let second = run.applied.iter().skip(third).take(third.saturating_sub(2));
    second.map(|(_, deg)| *deg).collect()
}

fn table(all: &[Vec<Looped>], stretch_s: f64) -> Table {
    let settled = format!("RMSE, m, {stretch_s:.0} to {:.0} s", 2.0 * stretch_s);
    let after = format!("RMSE, m, after {:.0} s", 2.5 * stretch_s);
    let mut table = Table::new(&[
        "the controller",
        &settled,
        "against the truth",
        &after,
        "against the truth",
        "applied offset, largest error",
        "its wandering",
        "steering estimate at the end, RMSE",
    ]);
    let jumped_m = |runs: &[Looped]| {
        rms(&runs
            .iter()
            .flat_map(|run| run.after_jump_m.clone())
            .collect::<Vec<_>>())
    };
    for (runs, (_, name)) in all.iter().zip(POLICIES) {
        let applied: Vec<_> = runs.iter().flat_map(settled_applied).collect();
        let wandering = runs.iter().map(|run| spread(&settled_applied(run)));
        let errors: Vec<_> = runs.iter().map(|run| run.errors[3].to_degrees()).collect();
        let (settled_m, after_m) = (settled_rmse_m(runs), jumped_m(runs));
        table.row([
            name.to_owned(),
            format!("{settled_m:.4}"),
            format!("{:.3} times", settled_m / settled_rmse_m(&all[TOLD])),
            format!("{after_m:.4}"),
            format!("{:.3} times", after_m / jumped_m(&all[TOLD])),
            format!("{:.4}°", largest(&applied)),
            format!("{:.4}°", wandering.fold(0.0, f64::max)),
            format!("{:.4}°", rms(&errors)),
        ]);
    }
    table
}

fn panel(all: &[Vec<Looped>], stretch_s: f64, shown_deg: f64) -> Panel {
    let policies = [(1, GREY_LINE), (3, ORANGE_LINE), (USUAL, BLUE_LINE)];
    let curves = policies.into_iter().flat_map(|(policy, colour)| {
        let runs = all[policy].iter();
        runs.map(move |run| Series::Line(run.applied.clone(), colour, 1))
    });
    let zero = vec![(0.0, 0.0), (3.0 * stretch_s, 0.0)];
    Panel {
        title: format!("steering zero jumps at {:.0} s", 2.0 * stretch_s),
        x_name: "time, s".to_owned(),
        y_name: "applied − true, °".to_owned(),
        x: 0.0..3.0 * stretch_s,
        y: -shown_deg..shown_deg,
        series: std::iter::once(Series::Line(zero, GREEN_LINE, 1))
            .chain(curves)
            .collect(),
        legend: Vec::new(),
    }
}
