//! A robot without imperfections sends what the simulator sent before it knew any.

use crate::simulator::{
    Change, Emitted, ImperfectionKind, Imperfections, LidarOutput, PoseSettings, ScheduledChange,
    SimulatedMessage, Simulation, SimulationConfig, Slip, VehicleModel,
};

/// Hashes every number by FNV-1a, rounded to a nanometre (a nanoradian, a nanosecond): the
/// mathematics library of another machine may differ in the last bit.
fn digest(messages: &[Emitted]) -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    let mut eat = |number: i64| {
        for byte in number.to_le_bytes() {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    };
    let rounded = |value: f64| (value * 1e9).round() as i64;
    for emitted in messages {
        eat(emitted.message.stamp_ns());
        eat(emitted.sent_ns);
        eat(rounded(emitted.truth.base.x_m));
        eat(rounded(emitted.truth.lidar.yaw_rad));
        match &emitted.message {
            SimulatedMessage::WheelOdometry(drive) => {
                eat(rounded(drive.speed_mps));
                eat(rounded(drive.steering_rad));
            }
            // The stream carries 32-bit ranges: a tenth of a millimetre is what they all hold.
            SimulatedMessage::Scan(scan) => scan.ranges_m.iter().for_each(|range_m| {
                eat((f64::from(*range_m) * 1e4).round() as i64);
            }),
            SimulatedMessage::LidarPose(pose) => {
                eat(rounded(pose.pose.x_m));
                eat(rounded(pose.pose.yaw_rad));
            }
            SimulatedMessage::CrossTrackError(error) => eat(rounded(error.value_m)),
        }
    }
    hash
}

fn scans() -> SimulationConfig {
    let mut config = SimulationConfig::figure_eight(4);
    config.vehicle.steering_gain = 1.02;
    config.vehicle.speed_scale = 0.99;
    config.vehicle.time_offset_s = 0.03;
    config.vehicle.slip.lateral_rad_per_mps2 = 0.002;
    config
}

fn poses() -> SimulationConfig {
    let mut config = SimulationConfig::figure_eight(5);
    config.vehicle.model = VehicleModel::Tricycle;
    config.vehicle.slip = Slip {
        longitudinal_sigma: 0.003,
        lateral_rad_per_mps2: 0.001,
    };
    config.lidar = LidarOutput::Poses(PoseSettings::default());
    config.changes = vec![ScheduledChange {
        at_s: 20.0,
        change: Change::SteeringOffset(0.02),
    }];
    config
}

#[test]
fn a_robot_without_imperfections_sends_what_it_always_sent() {
    let sent = |config, duration_s| digest(&Simulation::new(config).unwrap().run(duration_s));
    assert_eq!(sent(scans(), 12.0), 0xd236_090c_2d96_d73d);
    assert_eq!(sent(poses(), 60.0), 0x3808_39b9_45b7_adda);
}

#[test]
fn an_imperfection_of_no_size_changes_no_bit() {
    let plain = format!("{:?}", Simulation::new(scans()).unwrap().run(3.0));
    for kind in ImperfectionKind::ALL
        .into_iter()
        .filter(|kind| kind.has_size())
    {
        let mut config = scans();
        config.imperfections = Imperfections::single(kind, 0.0);
        let sent = format!("{:?}", Simulation::new(config).unwrap().run(3.0));
        assert!(sent == plain, "{}", kind.name());
    }
}
