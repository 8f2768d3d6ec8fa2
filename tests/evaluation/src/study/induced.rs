//! Study 3: steering offsets induced on purpose (Table III).

use super::cases::{COLUMNS, ITALIC, Outcome, PLAIN, cells, hold_to_a_tenth, remark, runs};
use crate::error::EvaluationError;
use crate::extent::Extent;
use crate::paper::INDUCED;
use crate::report::{Section, Table};
use crate::robots::{TUGGER_CAD, mount, tugger};
use crate::statistics::{mean, spread};

/// Runs the study.
///
/// # Errors
/// The error of a run.
pub fn study(extent: &Extent) -> Result<Section, EvaluationError> {
    let mut section = Section::new("3. Induced offsets (Table III)");
    section.words(
        "The tugger of study 1, from CAD values, with its steering mechanism turned on purpose. The \
         paper knows what it induced but not the mount; its worst steering error is 0.27°, its three \
         repeats at 5° spread by 0.03°, and its extrinsics by 1.7 cm, 3.3 cm and 0.22°.",
    );
    let mut table = Table::new(&["run", COLUMNS[0], COLUMNS[1], COLUMNS[2], COLUMNS[3]]);
    let mut outcomes = Vec::new();
    for (n, (induced_deg, paper)) in INDUCED.iter().enumerate() {
        // Each trial has its own seeds, as three repeats of 5° are three drives.
        let first = 1000 * (n as u64 + 1);
        let seeds: Vec<_> = extent.seeds().iter().map(|seed| first + seed).collect();
        let runs = runs(&seeds, extent.calibration_s, |seed| {
            let mut robot = tugger(seed, mount(0.43, 0.0046, 0.72), *induced_deg);
            robot.calibrator.nominal_lidar_in_base = Some(TUGGER_CAD);
            robot
        })?;
        let outcome = Outcome::of("induced offsets", &runs)?;
        let means = [0, 1, 2, 3].map(|i| mean(&outcome.values[i]));
        let spreads = [0, 1, 2, 3].map(|i| spread(&outcome.values[i]));
        table.row(cells(
            &format!("*induced {induced_deg}°: paper*"),
            paper,
            ITALIC,
        ));
        table.row(cells("truth", &outcome.truth, PLAIN));
        table.row(cells(
            &format!("fleetcal, mean of {}", seeds.len()),
            &means,
            PLAIN,
        ));
        table.row(cells("fleetcal, spread", &spreads, PLAIN));
        table.row(cells("fleetcal, worst error", &outcome.worst(), PLAIN));
        outcomes.push(outcome);
    }
    section.table(table);
    let all: Vec<_> = outcomes.iter().collect();
    section.words(remark(&all));
    hold_to_a_tenth(&mut section, &all);
    let repeats: Vec<_> = outcomes
        .iter()
        .skip(2)
        .flat_map(|o| o.values[3].clone())
        .collect();
    section.at_most("spread of repeats at 5°", spread(&repeats), 0.003, |deg| {
        format!("{deg:.4}°")
    });
    Ok(section)
}
