//! False alarms of the change test with nothing to find are as rare as configured.

use fleetcal_estimator::EstimatorSettings;
use fleetcal_estimator::change::evidence::{Thresholds, WINDOWS_PER_HOUR};

use crate::synthetic_windows::{Alarms, NoiseWindows, routes, windows_of};
use crate::unchanged::hour;

#[test]
fn at_a_scaled_down_threshold_the_run_is_at_least_as_long_as_stated() {
    let stated_windows = 2000.0;
    let thresholds = Thresholds::for_false_alarm_hours(stated_windows / WINDOWS_PER_HOUR);
    let mut alarms = Alarms::default();
    for (route, seed) in routes().into_iter().zip(1..) {
        let mut noise = NoiseWindows::new(windows_of(route, 240.0), seed);
        for _ in 0..40_000 {
            noise.advance();
            alarms.push(noise.alarms(&thresholds));
        }
    }
    let run = alarms.run_length();
    println!("stated one in {stated_windows} windows, measured one in {run:.0}");
    // The thresholds were fitted without the wander that is allowed for, so they promise too little.
    assert!(
        (stated_windows..8.0 * stated_windows).contains(&run),
        "one in {run} windows"
    );
}

#[test]
fn nothing_is_flagged_in_hours_without_a_change() {
    for seed in 1..=5 {
        let changes = hour(seed);
        assert!(changes.is_empty(), "robot {seed}: {changes:?}");
    }
}

#[test]
fn a_rarer_false_alarm_needs_more_evidence() {
    let usual = EstimatorSettings::default().false_alarm_hours;
    let (often, seldom) = (
        Thresholds::for_false_alarm_hours(usual),
        Thresholds::for_false_alarm_hours(100.0 * usual),
    );
    for (low, high) in often.values().iter().zip(seldom.values()) {
        // Near to 2 ln(100), what the likelihood ratio of pure chance asks for.
        assert!((9.0..11.0).contains(&(high - low)), "{low}, {high}");
    }
}
