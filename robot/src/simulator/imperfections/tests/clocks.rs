//! Stamps and losses.

use super::{drives, poses, quiet, run, with};
use crate::simulator::{ClockImperfections, ImperfectionKind, Imperfections, Simulation};

#[test]
fn the_drive_streams_clock_drifts_away_from_the_lidars() {
    let config = with(
        quiet(),
        Imperfections::typical(ImperfectionKind::ClockDrift),
    );
    let start_ns = config.start_stamp_ns;
    let mut simulation = Simulation::new(config).unwrap();
    let messages = simulation.run(60.0);
    for (drive, emitted) in drives(&messages) {
        let since_s = (emitted.truth.stamp_ns - start_ns) as f64 * 1e-9;
        let late_s = (drive.stamp_ns - emitted.truth.stamp_ns) as f64 * 1e-9;
        assert!(
            (late_s - 1e-4 * since_s).abs() < 2e-9,
            "{since_s}: {late_s}"
        );
    }
    assert!(
        poses(&messages)
            .iter()
            .all(|(pose, e)| pose.stamp_ns == e.truth.stamp_ns)
    );
    assert!((simulation.parameters().time_offset_s - 0.006).abs() < 1e-6);
}

#[test]
fn stamps_tremble_by_the_given_sigma_and_still_rise() {
    let config = with(
        quiet(),
        Imperfections::typical(ImperfectionKind::StampJitter),
    );
    let mut simulation = Simulation::new(config).unwrap();
    let messages: Vec<_> = (0..30_000).map(|_| simulation.advance()).collect();
    let poses = poses(&messages);
    let off_s = poses
        .iter()
        .map(|(pose, e)| (pose.stamp_ns - e.truth.stamp_ns) as f64 * 1e-9);
    let square: f64 = off_s.map(|off| off * off).sum();
    let sigma_s = (square / poses.len() as f64).sqrt();
    assert!((sigma_s - 0.005).abs() < 4e-4, "{sigma_s}");
    assert!(poses.is_sorted_by(|a, b| a.0.stamp_ns < b.0.stamp_ns));
    let drives = drives(&messages);
    assert!(drives.is_sorted_by(|a, b| a.0.stamp_ns < b.0.stamp_ns));
    let trembling = drives
        .iter()
        .filter(|(drive, e)| drive.stamp_ns != e.truth.stamp_ns);
    assert!(trembling.count() > drives.len() * 9 / 10);
}

#[test]
fn the_given_share_of_both_streams_is_lost() {
    let imperfections = Imperfections {
        clocks: ClockImperfections {
            lost_messages: 0.1,
            ..ClockImperfections::default()
        },
        ..Imperfections::default()
    };
    let (all, left) = (
        run(quiet(), 100.0),
        run(with(quiet(), imperfections), 100.0),
    );
    let share = |left: usize, all: usize| 1.0 - left as f64 / all as f64;
    let drives_lost = share(drives(&left).len(), drives(&all).len());
    let poses_lost = share(poses(&left).len(), poses(&all).len());
    assert!((drives_lost - 0.1).abs() < 0.015, "{drives_lost}");
    assert!((poses_lost - 0.1).abs() < 0.04, "{poses_lost}");
}
