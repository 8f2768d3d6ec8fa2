//! Routes with stretches that are driven backwards.

use std::sync::Arc;

use super::{
    LidarOutput, PoseSettings, Route, SimulatedMessage, Simulation, SimulationConfig, World,
};

#[test]
fn a_robot_backs_up_twice_in_every_lap_and_keeps_to_its_route() {
    let mut config = SimulationConfig::figure_eight(3);
    config.world = Arc::new(World::empty_hall());
    config.route = Route::aisles_with_reversals();
    config.lidar = LidarOutput::Poses(PoseSettings::default());
    let messages = Simulation::new(config).unwrap().run(200.0);
    let mut backwards_m = Vec::new();
    let mut going_back = false;
    for emitted in &messages {
        let SimulatedMessage::WheelOdometry(drive) = emitted.message else {
            continue;
        };
        let speed_mps = emitted.truth.speed_mps;
        assert!((drive.speed_mps - speed_mps).abs() < 0.05);
        if speed_mps < -0.01 {
            if !going_back {
                backwards_m.push(0.0);
            }
            going_back = true;
        } else if speed_mps > 0.01 {
            going_back = false;
        }
        if let (true, Some(stretch_m)) = (going_back, backwards_m.last_mut()) {
            *stretch_m += -speed_mps * 0.01;
        }
        let beside_m = emitted.truth_when_sent.cross_track_error_m;
        assert!(beside_m.abs() < 0.15, "{beside_m} m beside the route");
    }
    assert!(backwards_m.len() >= 4, "two laps: {backwards_m:?}");
    for (stretch_m, expected_m) in backwards_m.iter().zip([2.5, 3.0, 2.5, 3.0]) {
        assert!((stretch_m - expected_m).abs() < 0.3, "{backwards_m:?}");
    }
}
