//! The store as its callers see it.

mod administration;
mod connection;
mod durability;
mod history;
mod records;
mod transaction;
mod upgrade;

use std::path::Path;
use std::sync::Arc;

use fleetcal_clock::MockClock;
use fleetcal_model::{Consistency, Counts, Parameter, ParameterStatus, RobotTime, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::{EstimateDocument, ParameterDocument, Parameters};
use fleetcal_store::{HistoryQuery, Store};

/// Wall time at which the tests begin, s: 2026-01-01.
const NOW_S: i64 = 1_767_225_600;
const NS: i64 = 1_000_000_000;

fn robot(name: &str) -> RobotId {
    RobotId::parse(name).unwrap()
}

fn clock() -> Arc<MockClock> {
    MockClock::at(NOW_S * NS)
}

async fn open(folder: &Path, clock: &Arc<MockClock>) -> Store {
    crate::open(folder, Arc::clone(clock) as _).await.unwrap()
}

/// An estimate of second `t_s` with this steering offset and LiDAR yaw; wheelbase and steering
/// gain are fixed, the rest is 0.5.
fn estimate(name: &str, t_s: i64, offset_rad: f64, yaw_rad: f64) -> EstimateDocument {
    let parameter = |parameter: Parameter| {
        let (value, status) = match parameter {
            Parameter::SteeringOffset => (offset_rad, ParameterStatus::Converged),
            Parameter::LidarYaw => (yaw_rad, ParameterStatus::Learning),
            Parameter::Wheelbase | Parameter::SteeringGain => (1.0, ParameterStatus::Fixed),
            _ => (0.5, ParameterStatus::Unobservable),
        };
        ParameterDocument {
            value,
            sigma: 0.01,
            unit: parameter.unit(),
            status,
            needs: None,
        }
    };
    EstimateDocument {
        robot: robot(name),
        stamp_ns: RobotTime(t_s * NS + 7),
        time_s: 1.0,
        distance_m: 2.0,
        parameters: Parameters {
            steering_offset: parameter(Parameter::SteeringOffset),
            lidar_x: parameter(Parameter::LidarX),
            lidar_y: parameter(Parameter::LidarY),
            lidar_yaw: parameter(Parameter::LidarYaw),
            speed_scale: parameter(Parameter::SpeedScale),
            wheelbase: parameter(Parameter::Wheelbase),
            time_offset: parameter(Parameter::TimeOffset),
            steering_gain: parameter(Parameter::SteeringGain),
        },
        covariance: None,
        detection: None,
        consistency: Consistency {
            nis_mean: 3.0,
            nis_dof: 3.0,
            samples: 10,
        },
        counts: Counts::default(),
        lidar_in_base_link: None,
    }
}

/// Records an estimate that is received at its own time.
fn record(store: &Store, name: &str, t_s: i64, offset_rad: f64) {
    store.record_history(&estimate(name, t_s, offset_rad, 0.0), WallTime(t_s * NS));
}

fn query(name: &str, from_s: i64, to_s: i64, points_max: u32) -> HistoryQuery {
    let parameters = vec![Parameter::SteeringOffset, Parameter::LidarYaw];
    HistoryQuery {
        robot: robot(name),
        parameters,
        from_s,
        to_s,
        points_max,
    }
}
