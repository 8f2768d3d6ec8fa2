//! Robots on which nothing changes.

use fleetcal_estimator::estimate::Change;
use fleetcal_robot::simulator::{Point, Route};

use crate::drawn::{drawn, drawn_with_white_noise};
use crate::drive::drive;

/// Length of a run, s.
pub const HOUR_S: f64 = 3600.0;

/// Changes that are flagged in an hour of a robot whose vehicle and route depend on the seed. Of
/// two robots one slips and has a coarse encoder, the other's noise is as the filter models it.
pub fn hour(seed: u64) -> Vec<Change> {
    let (mut config, calibrator) = if seed.is_multiple_of(2) {
        drawn_with_white_noise(seed)
    } else {
        drawn(seed)
    };
    let centre = Point::new(-11.0, 0.0);
    config.route = match seed % 5 {
        0 | 1 => Route::staging_figure_eight(),
        2 => Route::aisle_loop(),
        3 => Route::left_loop(centre, 10.0, 5.0),
        _ => Route::figure_eight(centre, 8.0, 4.0),
    };
    drive(config, calibrator, HOUR_S).changes
}
