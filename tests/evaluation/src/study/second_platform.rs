//! Study 2: another platform.

use super::cases::{COLUMNS, Outcome, hold_to_a_tenth, remark, runs};
use crate::error::EvaluationError;
use crate::extent::Extent;
use crate::paper::NANO;
use crate::report::{Section, Table};
use crate::robots::{NANO_CAD, mount, nano};

/// Runs the study.
///
/// # Errors
/// The error of a run.
pub fn study(extent: &Extent) -> Result<Section, EvaluationError> {
    let mut section = Section::new("2. Second platform");
    section.words(
        "A small robot with a wheelbase of 0.5 m at 0.3 to 0.9 m/s on a figure-eight of 6 m by 2 m, \
         from CAD values (0.26 m ahead of the axle). Its truth is what the paper found on its nano.",
    );
    let runs = runs(&extent.seeds(), extent.calibration_s, |seed| {
        let mut robot = nano(seed, mount(0.2597, 0.0101, -1.29), -1.11);
        robot.calibrator.nominal_lidar_in_base = Some(NANO_CAD);
        robot
    })?;
    let outcome = Outcome::of("second platform", &runs)?;
    let mut table = Table::new(&["run", COLUMNS[0], COLUMNS[1], COLUMNS[2], COLUMNS[3]]);
    outcome.rows(&mut table, "nano", &NANO);
    section.table(table);
    section.words(remark(&[&outcome]));
    hold_to_a_tenth(&mut section, &[&outcome]);
    Ok(section)
}
