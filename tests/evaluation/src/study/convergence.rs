//! Study 1: convergence from CAD values and from zero, unladen and laden (Tables I and II).

use fleetcal_estimator::Status;
use fleetcal_estimator::geometry::Pose2;

use super::cases::{COLUMNS, Outcome, SHOWN, hold_to_a_tenth, remark, runs};
use crate::drive::{Driven, FOUR, Robot, error_of};
use crate::error::EvaluationError;
use crate::extent::Extent;
use crate::paper::{
    Converged, LADEN_FROM_CAD, LADEN_FROM_ZERO, UNLADEN_FROM_CAD, UNLADEN_FROM_ZERO,
};
use crate::plot::{BLUE_LINE, GREY_LINE, Panel, Series, figure};
use crate::report::{Section, Table};
use crate::robots::{TUGGER_CAD, laden, mount, tugger};

const STUDY: &str = "convergence";
/// Shown part of the errors: m, m, degrees, degrees.
const SHOWN_ERROR: [f64; 4] = [0.02, 0.02, 0.15, 0.15];

struct Case {
    name: &'static str,
    paper: Converged,
    runs: Vec<Driven>,
    outcome: Outcome,
}

/// Runs the study.
///
/// # Errors
/// The error of a run or a figure.
pub fn study(extent: &Extent) -> Result<Section, EvaluationError> {
    let mut section = Section::new("1. Convergence (Tables I and II)");
    section.words(format!(
        "A tugger drives the figure-eight for {} s by its own path following, with raw scans of 1024 \
         beams, three people walking about and a steering encoder of 0.25°. Its truth is the paper's \
         estimate. Under load its mount is 1 cm further ahead, its tyres give way in bends (0.002 rad \
         for each m/s²) and its wheels slip by 0.3 % instead of 0.2 %. On top, in all studies: wheels \
         0.5 % larger than configured and wheel odometry that is 20 ms late, which the paper's model \
         leaves out.",
        extent.convergence_s
    ));
    let from_cad = cases(extent, Some(TUGGER_CAD), UNLADEN_FROM_CAD, LADEN_FROM_CAD)?;
    let from_zero = cases(extent, None, UNLADEN_FROM_ZERO, LADEN_FROM_ZERO)?;
    for (heading, name, cases) in [
        ("from CAD values", "convergence_from_cad", &from_cad),
        (
            "from zero: nothing is known of the mount",
            "convergence_from_zero",
            &from_zero,
        ),
    ] {
        section.words(format!("**Started {heading}.**"));
        let mut table = Table::new(&["run", COLUMNS[0], COLUMNS[1], COLUMNS[2], COLUMNS[3]]);
        for case in cases {
            case.outcome.rows(&mut table, case.name, &case.paper);
        }
        section.table(table);
        let caption = format!(
            "Errors, started {heading}: unladen above, laden below. Blue: seed 1 with its 3-sigma \
             bounds; grey: the other seeds"
        );
        let panels: Vec<_> = cases.iter().flat_map(panels).collect();
        section.figure(figure(name, &caption, 4, &panels)?);
    }
    let outcomes: Vec<_> = from_cad
        .iter()
        .chain(&from_zero)
        .map(|case| &case.outcome)
        .collect();
    section.words(remark(&outcomes));
    section.words(
        "How the worst error of all these runs falls with time, beside the 2 mm, 0.022° and 0.03° that \
         the last row is held to:",
    );
    let cases: Vec<_> = from_cad.iter().chain(&from_zero).collect();
    section.table(over_time(&cases, extent.convergence_s));
    hold_to_a_tenth(&mut section, &outcomes);
    Ok(section)
}

/// Makes the table of the worst errors of all runs at some times, and the numbers of converged
/// parameters.
fn over_time(cases: &[&Case], last_s: f64) -> Table {
    let mut table = Table::new(&[
        "after",
        "x, mm",
        "y, mm",
        "yaw, °",
        "steering, °",
        "converged of 4, mean",
    ]);
    let times = [20.0, 30.0, 60.0, 120.0, 180.0, 240.0, 300.0];
    for time_s in times.into_iter().filter(|time_s| *time_s <= last_s) {
        let (mut worst, mut converged, mut count) = ([0.0_f64; 4], 0_usize, 0_usize);
        for run in cases.iter().flat_map(|case| &case.runs) {
            let until = run.estimates.iter().rev();
            let mut until = until.filter(|(estimate, _)| estimate.time_s <= time_s);
            let Some((estimate, truth)) = until.next() else {
                continue;
            };
            for (worst, (parameter, unit)) in worst.iter_mut().zip(FOUR.into_iter().zip(SHOWN)) {
                let found = estimate.parameter(parameter);
                *worst = worst.max((unit * error_of(parameter, found.value, truth)).abs());
                converged += usize::from(found.status == Status::Converged);
            }
            count += 1;
        }
        let [x_m, y_m, yaw_deg, steering_deg] = worst;
        table.row([
            format!("{time_s:.0} s"),
            format!("{:.2}", 1e3 * x_m),
            format!("{:.2}", 1e3 * y_m),
            format!("{yaw_deg:.4}"),
            format!("{steering_deg:.4}"),
            format!("{:.1}", converged as f64 / count.max(1) as f64),
        ]);
    }
    table
}

/// Runs the cases unladen and laden.
fn cases(
    extent: &Extent,
    nominal: Option<Pose2>,
    unladen_in_paper: Converged,
    laden_in_paper: Converged,
) -> Result<[Case; 2], EvaluationError> {
    let told = |mut robot: Robot| {
        robot.calibrator.nominal_lidar_in_base = nominal;
        robot
    };
    let unladen = |seed| told(tugger(seed, mount(0.43, 0.0046, 0.72), 0.92));
    let loaded = |seed| told(laden(tugger(seed, mount(0.44, 0.0055, 0.73), 0.92)));
    Ok([
        case(extent, "unladen", unladen_in_paper, unladen)?,
        case(extent, "laden", laden_in_paper, loaded)?,
    ])
}

fn case(
    extent: &Extent,
    name: &'static str,
    paper: Converged,
    robot: impl Fn(u64) -> Robot + Sync,
) -> Result<Case, EvaluationError> {
    let runs = runs(&extent.seeds(), extent.convergence_s, robot)?;
    Ok(Case {
        name,
        paper,
        outcome: Outcome::of(STUDY, &runs)?,
        runs,
    })
}

/// Makes the panels of errors over time, one for each of the four.
fn panels(case: &Case) -> Vec<Panel> {
    let names = ["x", "y", "yaw", "steering"];
    let units = ["m", "m", "°", "°"];
    let last_s = case.runs.iter().filter_map(|run| run.estimates.last());
    let last_s = last_s.fold(1.0, |last: f64, (estimate, _)| last.max(estimate.time_s));
    (0..4)
        .map(|i| {
            let mut series: Vec<_> = case
                .runs
                .iter()
                .skip(1)
                .map(|run| Series::Line(curve(run, i, |error, _| error), GREY_LINE, 1))
                .collect();
            if let Some(run) = case.runs.first() {
                let bound = |side: f64| curve(run, i, move |_, sigma| side * 3.0 * sigma);
                series.push(Series::Band(bound(-1.0), bound(1.0), BLUE_LINE));
                series.push(Series::Line(curve(run, i, |error, _| error), BLUE_LINE, 2));
            }
            Panel {
                title: format!("{}: {}", case.name, names[i]),
                x_name: "time, s".to_owned(),
                y_name: format!("error, {}", units[i]),
                x: 0.0..last_s,
                y: -SHOWN_ERROR[i]..SHOWN_ERROR[i],
                series,
                legend: Vec::new(),
            }
        })
        .collect()
}

fn curve(run: &Driven, i: usize, of: impl Fn(f64, f64) -> f64) -> Vec<(f64, f64)> {
    let (parameter, unit) = (FOUR[i], SHOWN[i]);
    let points = run.estimates.iter().map(|(estimate, truth)| {
        let found = estimate.parameter(parameter);
        let error = unit * error_of(parameter, found.value, truth);
        (estimate.time_s, of(error, unit * found.sigma))
    });
    points.collect()
}
