//! Presets, draws and refusals.

use super::{quiet, quiet_scans, with};
use crate::simulator::{ImperfectionKind, Imperfections, Simulation, Strength};

#[test]
fn every_preset_is_an_imperfection_that_can_be_simulated() {
    let (poses, scans) = (quiet(), quiet_scans());
    for kind in ImperfectionKind::ALL {
        assert_eq!(ImperfectionKind::by_name(kind.name()), Some(kind));
        let (typical, strong) = (Imperfections::typical(kind), Imperfections::strong(kind));
        assert!(!typical.is_none(), "{}", kind.name());
        assert_eq!(typical == strong, !kind.has_size(), "{}", kind.name());
        for imperfections in [typical, strong] {
            Simulation::new(with(scans.clone(), imperfections)).unwrap();
            let with_poses = Simulation::new(with(poses.clone(), imperfections));
            assert_eq!(with_poses.is_err(), kind.needs_scans(), "{}", kind.name());
        }
    }
    assert_eq!(ImperfectionKind::by_name("gremlins"), None);
}

#[test]
fn every_robot_has_its_own_signs_and_sizes() {
    let gain = |seed| {
        Imperfections::drawn(ImperfectionKind::SteeringGain, Strength::Strong, seed)
            .vehicle
            .steering_gain
    };
    let gains: Vec<_> = (0..20).map(gain).collect();
    assert!(gains.iter().all(|gain| (gain.abs() - 0.03).abs() < 1e-12));
    assert!(gains.iter().any(|gain| *gain > 0.0) && gains.iter().any(|gain| *gain < 0.0));
    let (poses, scans) = (quiet(), quiet_scans());
    for seed in 0..200 {
        let with_scans = Imperfections::all_typical(seed, true);
        let with_poses = Imperfections::all_typical(seed, false);
        assert_eq!(with_scans, Imperfections::all_typical(seed, true));
        assert_ne!(with_scans, Imperfections::all_typical(seed + 1, true));
        assert_eq!(with_scans.vehicle, with_poses.vehicle);
        let (lag_s, delay_s) = (
            with_scans.vehicle.steering_lag_s,
            with_scans.vehicle.steering_delay_s,
        );
        assert!((lag_s > 0.0) != (delay_s > 0.0), "{lag_s} {delay_s}");
        let bias_m = with_scans.scanner.range_bias_m.abs();
        assert!((0.015..0.045).contains(&bias_m), "{bias_m}");
        let rate_hz = with_scans.lidar.scan_rate_hz.unwrap();
        assert!((5.0..40.0).contains(&rate_hz), "{rate_hz}");
        Simulation::new(with(scans.clone(), with_scans)).unwrap();
        Simulation::new(with(poses.clone(), with_poses)).unwrap();
    }
}

#[test]
fn an_imperfection_that_cannot_be_is_refused_by_name() {
    let refused = |spoil: &dyn Fn(&mut Imperfections)| {
        let mut imperfections = Imperfections::default();
        spoil(&mut imperfections);
        let refused = Simulation::new(with(quiet(), imperfections)).unwrap_err();
        (refused.field, refused.value.to_string(), refused.accepted)
    };
    assert_eq!(
        refused(&|all| all.vehicle.steering_gain = 1.01),
        (
            "imperfections.vehicle.steering_gain",
            "1.01".to_owned(),
            "-0.3 to 0.3"
        )
    );
    assert_eq!(
        refused(&|all| all.clocks.lost_messages = f64::NAN).0,
        "imperfections.clocks.lost_messages"
    );
    assert_eq!(
        refused(&|all| all.lidar.scan_rate_hz = Some(0.0)).0,
        "imperfections.lidar.scan_rate_hz"
    );
    let (field, value, accepted) = refused(&|all| all.scanner.untimed_beams = true);
    assert_eq!(
        (field, value.as_str()),
        ("imperfections.scanner.untimed_beams", "1")
    );
    assert!(accepted.contains("sends poses"));
}
