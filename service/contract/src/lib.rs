//! Fixtures of the store's tests: a database of their own, records and estimates.
//!
//! Tests that name no database run on SQLite, and once more on PostgreSQL when
//! [`SERVER`] names a server that may be filled with databases.
#![expect(
    clippy::missing_panics_doc,
    clippy::panic,
    clippy::unwrap_used,
    reason = "only tests use it"
)]

mod database;
mod instance;
mod jobs;
pub mod own_server;

use std::sync::Arc;

use fleetcal_clock::MockClock;
use fleetcal_domain::robot::RobotConfig;
use fleetcal_model::{Consistency, Counts, Parameter, ParameterStatus, RobotTime, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::{EstimateDocument, ParameterDocument, Parameters};
use fleetcal_store::{EventKind, EventSource, HistoryQuery, NewEvent, Store};

pub use database::{SERVER, TestDatabase, server};
pub use instance::{instance, joining, open_instance};
pub use jobs::{AddUser, AppendAudit, IsThere, KeepCertificate, KeepRobot};

/// Wall time at which the tests begin, s: 2026-01-01.
pub const NOW_S: i64 = 1_767_225_600;
/// Nanoseconds in a second.
pub const NS: i64 = 1_000_000_000;

/// Makes the id of a robot.
pub fn robot(name: &str) -> RobotId {
    RobotId::parse(name).unwrap()
}

/// Makes a clock that stands at [`NOW_S`].
pub fn clock() -> Arc<MockClock> {
    MockClock::at(NOW_S * NS)
}

/// Makes an estimate of second `t_s` with this steering offset and LiDAR yaw; wheelbase and
/// steering gain are fixed, the rest is 0.5.
///
pub fn estimate(name: &str, t_s: i64, offset_rad: f64, yaw_rad: f64) -> EstimateDocument {
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
        steering_table: None,
        reassembly_open: false,
        detection: None,
        consistency: Consistency::of(3.0, 3.0, 10, None),
        counts: Counts::default(),
        motions: None,
        lidar_in_base_link: None,
        estimated_by: None,
    }
}

/// Records an estimate that is received at its own time.
pub fn record(store: &Store, name: &str, t_s: i64, offset_rad: f64) {
    store.record_history(&estimate(name, t_s, offset_rad, 0.0), WallTime(t_s * NS));
}

/// Makes a query for steering offset and LiDAR yaw from `from_s` to `to_s`.
pub fn query(name: &str, from_s: i64, to_s: i64, points_max: u32) -> HistoryQuery {
    let parameters = vec![Parameter::SteeringOffset, Parameter::LidarYaw];
    HistoryQuery {
        robot: robot(name),
        parameters,
        from_s,
        to_s,
        points_max,
    }
}

/// Makes the configuration of a robot.
pub fn config(wheelbase_m: f64) -> RobotConfig {
    serde_json::from_value(serde_json::json!({"model": "bicycle", "wheelbase_m": wheelbase_m}))
        .unwrap()
}

/// Makes an event of robot `a` with this note.
pub fn event(note: &str) -> NewEvent {
    NewEvent {
        robot: robot("a"),
        kind: EventKind::Reassembled,
        stamp_ns: RobotTime(5),
        received_ns: WallTime(NOW_S * NS),
        source: EventSource::Person,
        author: Some("Ann".to_owned()),
        note: Some(note.to_owned()),
        details: Some(serde_json::json!({"change": {"lidar_x": 0.1}})),
    }
}
