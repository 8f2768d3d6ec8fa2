//! Checkpoints, gaps, sessions and bad order.

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::{Calibrator, Checkpoint, Parameter};
use fleetcal_robot::simulator::SimulationConfig;

use crate::drive::{drive, poses, vehicle_of};

#[test]
fn a_checkpoint_comes_back_bit_for_bit_and_is_small() {
    let mut config = SimulationConfig::figure_eight(4);
    config.lidar = poses();
    let calibrator = CalibratorConfig::of(vehicle_of(&config.vehicle, 1.2));
    let run = drive(config, calibrator.clone(), 40.0);
    let written = serde_json::to_string(&run.calibrator.checkpoint()).unwrap();
    assert!(written.len() < 64 * 1024, "{} bytes", written.len());
    let read: Checkpoint = serde_json::from_str(&written).unwrap();
    assert_eq!(read, run.calibrator.checkpoint());
    let restored = Calibrator::restore(calibrator, &read).unwrap();
    let (before, after) = (run.calibrator.estimate(), restored.estimate());
    for parameter in Parameter::ALL {
        assert_eq!(before.parameter(parameter), after.parameter(parameter));
    }
}
