//! CPU time of the filter's steps: `cargo bench -p fleetcal-estimator --bench filter`.

#![expect(clippy::unwrap_used, reason = "a benchmark that cannot go on ends")]

#[path = "../tests/calibration/drive.rs"]
#[expect(dead_code, reason = "the tests use more of it")]
mod drive;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use drive::{event_of, poses, vehicle_of};
use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::{Calibrator, Event};
use fleetcal_robot::simulator::{Simulation, SimulationConfig};

/// A minute of driving with LiDAR poses, and the ten seconds after it.
fn recorded() -> (CalibratorConfig, Vec<Event>, Vec<Event>) {
    let mut config = SimulationConfig::figure_eight(1);
    config.lidar = poses();
    let calibrator = CalibratorConfig::of(vehicle_of(&config.vehicle, 1.2));
    let mut simulation = Simulation::new(config).unwrap();
    let mut events = |duration_s| {
        let emitted = simulation.run(duration_s);
        emitted
            .into_iter()
            .filter_map(|emitted| event_of(emitted.message))
            .collect()
    };
    (calibrator, events(60.0), events(10.0))
}

/// A hundred scans of a robot that has converged: a thousand drive samples, predictions, updates,
/// windows and the change test.
fn filter(criterion: &mut Criterion) {
    let (config, first, then) = recorded();
    let mut calibrator = Calibrator::new(config);
    for event in first {
        calibrator.step(event);
    }
    criterion.bench_function("100 scans, predict and update with all tests", |bencher| {
        bencher.iter_batched_ref(
            || (calibrator.clone(), then.clone()),
            |(calibrator, events)| {
                for event in events.drain(..) {
                    calibrator.step(event);
                }
            },
            BatchSize::LargeInput,
        );
    });
}

criterion_group!(benches, filter);
criterion_main!(benches);
