//! Rate of false alarms of the change test.
//!
//! `false_alarms fit [WINDOWS]` measures the run length between false alarms at scaled-down
//! thresholds, with noise alone in the windows, and fits the thresholds of
//! `change/evidence.rs` to it. `false_alarms campaign [HOURS]` drives simulated robots on which
//! nothing changes past the whole estimator at the real threshold, an hour each, and prints the
//! bound on the rate that this proves.

#![expect(clippy::unwrap_used, reason = "a measurement that cannot go on ends")]
#![expect(clippy::print_stdout, reason = "figures are printed")]

#[path = "../tests/calibration/drawn.rs"]
#[expect(dead_code, reason = "the tests use more of it")]
mod drawn;
#[path = "../tests/calibration/drive.rs"]
#[expect(dead_code, reason = "the tests use more of it")]
mod drive;
#[path = "../tests/calibration/synthetic_windows.rs"]
mod synthetic_windows;
#[path = "../tests/calibration/unchanged.rs"]
mod unchanged;

use std::sync::atomic::{AtomicU64, Ordering};

use fleetcal_estimator::EstimatorSettings;
use fleetcal_estimator::change::evidence::{CAUSES, HYPOTHESES, Thresholds, WINDOWS_PER_HOUR};
use synthetic_windows::{Alarms, NoiseWindows, routes, windows_of};

/// Thresholds at which run lengths are measured: 5, 6 and so on.
const LEVELS: usize = 26;
/// Run lengths (in windows) from which on, and numbers of alarms for which, the fit is made.
const FITTED_RUN_MIN: f64 = 1500.0;
const FITTED_ALARMS_MIN: u64 = 30;
/// Threads of the campaign.
const THREADS: usize = 2;

fn main() -> Result<(), String> {
    let mut arguments = std::env::args().skip(1);
    let what = arguments.next().unwrap_or_default();
    let count = arguments.next().map(|count| count.parse::<u64>());
    let count = count.transpose().map_err(|error| error.to_string())?;
    match what.as_str() {
        "fit" => fit(count.unwrap_or(3_000_000)),
        "campaign" => campaign(count.unwrap_or(3000)),
        _ => return Err("usage: false_alarms fit [WINDOWS] | campaign [HOURS]".to_owned()),
    }
    Ok(())
}

fn fit(windows: u64) {
    let levels: [f64; LEVELS] = std::array::from_fn(|i| 5.0 + i as f64);
    let mut counted = [[Alarms::default(); LEVELS]; CAUSES];
    let mut joint = [1e3, 1e4, 1e5].map(|stated| (stated, Alarms::default()));
    for (route, seed) in routes().into_iter().zip(1..) {
        let mut noise = NoiseWindows::new(windows_of(route, 240.0), seed);
        for _ in 0..windows / 3 {
            noise.advance();
            for (of_cause, ratio) in counted.iter_mut().zip(noise.largest_ratios()) {
                for (alarms, level) in of_cause.iter_mut().zip(levels) {
                    alarms.push(ratio >= level);
                }
            }
            for (stated, alarms) in &mut joint {
                let hours = *stated / WINDOWS_PER_HOUR;
                alarms.push(noise.alarms(&Thresholds::for_false_alarm_hours(hours)));
            }
        }
    }
    println!("{windows} windows of noise alone");
    for (hypothesis, of_cause) in HYPOTHESES.iter().zip(&counted) {
        let points: Vec<_> = of_cause
            .iter()
            .zip(levels)
            .filter(|(a, _)| a.count >= FITTED_ALARMS_MIN && a.run_length() >= FITTED_RUN_MIN)
            .collect();
        println!("{:?}", hypothesis.cause);
        for (alarms, level) in &points {
            println!(
                "  threshold {level}: {:>6} alarms, one in {:.0} windows",
                alarms.count,
                alarms.run_length()
            );
        }
        let (at_one, per_log) = line(&points);
        println!(
            "  threshold = {at_one:.2} + {per_log:.3} ln(windows); in use: {} + {} ln(windows)",
            hypothesis.threshold_at_one, hypothesis.threshold_per_log
        );
    }
    println!("all causes together, at the thresholds in use");
    for (stated, alarms) in &joint {
        println!(
            "  one in {stated:.0} windows stated: {:>6} alarms, one in {:.0} windows",
            alarms.count,
            alarms.run_length()
        );
    }
    let hours = EstimatorSettings::default().false_alarm_hours;
    let thresholds = Thresholds::for_false_alarm_hours(hours);
    println!(
        "one false alarm in {hours:.0} robot-hours of driving: thresholds {:.1?}",
        thresholds.values()
    );
}

/// Threshold against the log of the run length, each point weighted by its alarms.
fn line(points: &[(&Alarms, f64)]) -> (f64, f64) {
    let weighed = |of: &dyn Fn(f64, f64) -> f64| -> f64 {
        points
            .iter()
            .map(|(alarms, level)| alarms.count as f64 * of(alarms.run_length().ln(), *level))
            .sum()
    };
    let weight = weighed(&|_, _| 1.0);
    let (log, level) = (
        weighed(&|log, _| log) / weight,
        weighed(&|_, level| level) / weight,
    );
    let slope = weighed(&|x, y| (x - log) * (y - level)) / weighed(&|x, _| (x - log) * (x - log));
    (level - slope * log, slope)
}

fn campaign(hours: u64) {
    let (next, alarms) = (AtomicU64::new(1), AtomicU64::new(0));
    std::thread::scope(|scope| {
        for _ in 0..THREADS {
            scope.spawn(|| {
                loop {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    if seed > hours {
                        return;
                    }
                    let changes = unchanged::hour(seed);
                    alarms.fetch_add(changes.len() as u64, Ordering::Relaxed);
                    for change in changes {
                        println!("robot {seed}: {change:?}");
                    }
                    if seed % 100 == 0 {
                        println!(
                            "{seed} robot-hours begun, {} alarms",
                            alarms.load(Ordering::Relaxed)
                        );
                    }
                }
            });
        }
    });
    let alarms = alarms.into_inner();
    let stated = EstimatorSettings::default().false_alarm_hours;
    println!("{alarms} false alarms in {hours} robot-hours");
    println!(
        "upper bound of the rate at 95 %: one in {:.0} robot-hours; stated: one in {stated:.0}",
        hours as f64 / upper_bound_95(alarms)
    );
}

/// Largest mean of a Poisson variable that is `count` or less with a probability of 5 %.
fn upper_bound_95(count: u64) -> f64 {
    let at_most = |mean: f64| {
        let mut term = (-mean).exp();
        let mut sum = term;
        for k in 1..=count {
            term *= mean / k as f64;
            sum += term;
        }
        sum
    };
    let (mut low, mut high) = (0.0, 10.0 + 2.0 * count as f64);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if at_most(middle) > 0.05 {
            low = middle;
        } else {
            high = middle;
        }
    }
    high
}
