//! CPU time of the LiDAR odometry's stages: `cargo bench -p fleetcal-odometry`.

#[path = "../tests/scene/mod.rs"]
mod scene;

use criterion::{BatchSize, BenchmarkId, Criterion, criterion_group, criterion_main};
use fleetcal_odometry::{LidarOdometry, Pose2, Scan};
use scene::{Scanner, Scene, figure_eight, seeded, straight};

fn scans(scene: &Scene, scanner: &Scanner, route: &dyn Fn(f64) -> Pose2) -> Vec<Scan> {
    let mut rng = seeded(1);
    (0..300)
        .map(|index| {
            scanner
                .scan(scene, route, f64::from(index) * 0.1, &mut rng)
                .0
        })
        .collect()
}

/// The odometry after all but the last `rest` scans.
fn warmed(scans: &[Scan], rest: usize) -> LidarOdometry {
    let mut odometry = LidarOdometry::default();
    for scan in &scans[..scans.len() - rest] {
        odometry.process(scan);
    }
    odometry
}

/// Time of a hundred scans on the move: points, alignment, map upkeep.
fn driving(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("100 scans, driving");
    group.sample_size(20);
    let hall = Scene::warehouse().with_people(3, [9.0, 4.0], 3);
    for beams in [180, 360, 1024, 4096] {
        let scanner = Scanner {
            beams,
            ..Scanner::default()
        };
        let scans = scans(&hall, &scanner, &figure_eight);
        let warm = warmed(&scans, 100);
        group.bench_function(
            BenchmarkId::from_parameter(format!("{beams} beams")),
            |bencher| {
                bencher.iter_batched_ref(
                    || warm.clone(),
                    |odometry| {
                        scans[200..]
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

/// One scan in each situation that has its own way through the pipeline.
fn situations(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("one scan");
    let scanner = Scanner::default();
    let hall = scans(&Scene::warehouse(), &scanner, &figure_eight);
    let at_rest = scans(&Scene::warehouse(), &scanner, &|_| figure_eight(10.0));
    let corridor = scans(&Scene::corridor(), &scanner, &straight(0.0));
    let kidnapped = scans(&Scene::warehouse(), &scanner, &|t| {
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
    for (name, scans) in cases {
        let warm = warmed(scans, 1);
        group.bench_function(name, |bencher| {
            bencher.iter_batched_ref(
                || warm.clone(),
                |odometry| odometry.process(&scans[299]),
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
