//! CPU time of the LiDAR odometry's stages: `cargo bench -p fleetcal-estimator`.

#[path = "../tests/scene/mod.rs"]
mod scene;

use criterion::{BatchSize, BenchmarkId, Criterion, criterion_group, criterion_main};
use fleetcal_estimator::{LidarOdometry, Pose2, Sweep};
use scene::{Scanner, Scene, figure_eight, seeded, straight};

fn sweeps(scene: &Scene, scanner: &Scanner, route: &dyn Fn(f64) -> Pose2) -> Vec<Sweep> {
    let mut rng = seeded(1);
    (0..300)
        .map(|index| {
            scanner
                .sweep(scene, route, f64::from(index) * 0.1, &mut rng)
                .0
        })
        .collect()
}

/// The odometry after all but the last `rest` sweeps.
fn warmed(sweeps: &[Sweep], rest: usize) -> LidarOdometry {
    let mut odometry = LidarOdometry::default();
    for sweep in &sweeps[..sweeps.len() - rest] {
        odometry.process(sweep);
    }
    odometry
}

/// Time of a hundred sweeps on the move: points, alignment, map upkeep.
fn driving(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("100 sweeps, driving");
    group.sample_size(20);
    let hall = Scene::warehouse().with_people(3, [9.0, 4.0], 3);
    for beams in [180, 360, 1024, 4096] {
        let scanner = Scanner {
            beams,
            ..Scanner::default()
        };
        let sweeps = sweeps(&hall, &scanner, &figure_eight);
        let warm = warmed(&sweeps, 100);
        group.bench_function(
            BenchmarkId::from_parameter(format!("{beams} beams")),
            |bencher| {
                bencher.iter_batched_ref(
                    || warm.clone(),
                    |odometry| {
                        sweeps[200..]
                            .iter()
                            .filter_map(|s| odometry.process(s))
                            .count()
                    },
                    BatchSize::LargeInput,
                );
            },
        );
    }
    group.finish();
}

/// One sweep in each situation that has its own way through the pipeline.
fn situations(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("one sweep");
    let scanner = Scanner::default();
    let hall = sweeps(&Scene::warehouse(), &scanner, &figure_eight);
    let at_rest = sweeps(&Scene::warehouse(), &scanner, &|_| figure_eight(10.0));
    let corridor = sweeps(&Scene::corridor(), &scanner, &straight(0.0));
    let kidnapped = sweeps(&Scene::warehouse(), &scanner, &|t| {
        let pose = figure_eight(t);
        if t < 29.85 {
            pose
        } else {
            pose.compose(&Pose2::new(1.0, 0.0, 0.7))
        }
    });
    let cases = [
        ("at rest: alignment alone", &at_rest),
        ("corridor: with an open direction", &corridor),
        ("kidnapped: search, and lost", &kidnapped),
    ];
    for (name, sweeps) in cases {
        let warm = warmed(sweeps, 1);
        group.bench_function(name, |bencher| {
            bencher.iter_batched_ref(
                || warm.clone(),
                |odometry| odometry.process(&sweeps[299]),
                BatchSize::LargeInput,
            );
        });
    }
    group.bench_function("first: points and map, no alignment", |bencher| {
        bencher.iter_batched_ref(
            LidarOdometry::default,
            |odometry| odometry.process(&hall[200]),
            BatchSize::LargeInput,
        );
    });
    group.finish();
}

criterion_group!(benches, driving, situations);
criterion_main!(benches);
