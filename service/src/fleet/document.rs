//! From what an estimator says to the documents that travel.

use fleetcal_estimator::calibrator::Calibrator;
use fleetcal_estimator::estimate::{self, Cause, Change, ChangeKind, Estimate, Parameter, Status};
use fleetcal_estimator::{ParameterEstimate, Pose2, Vehicle, VehicleModel};
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::{
    self as document, CalibrationReport, ChangeCause, ChangeDocument, Consistency, Counts,
    EstimateDocument, ParameterDocument, ParameterName, ParameterStatus, Parameters, PoseDocument,
    Timing, VehicleDocument,
};

use crate::config::Mount;

/// The document of an estimate.
pub fn estimate_document(robot: &RobotId, estimate: &Estimate) -> EstimateDocument {
    EstimateDocument {
        robot: robot.clone(),
        stamp_ns: estimate.stamp.0,
        time_s: estimate.time_s,
        distance_m: estimate.distance_m,
        parameters: parameters(&estimate.parameters),
        consistency: consistency(&estimate.consistency),
        counts: Counts {
            drive_samples: estimate.counts.drive_samples,
            scans: estimate.counts.scans,
            scans_rejected: estimate.counts.scans_rejected,
            late: estimate.counts.late,
            duplicates: estimate.counts.duplicates,
        },
        lidar_in_base_link: None,
    }
}

/// The LiDAR's pose in `base_link`, in which the rear axle is where it is configured.
pub fn lidar_in_base_link(rear_axle_in_base_link: &Mount, of: &Parameters) -> PoseDocument {
    let value = |name| of.get(name).value;
    let lidar_in_rear_axle = Pose2::new(
        value(ParameterName::LidarX),
        value(ParameterName::LidarY),
        value(ParameterName::LidarYaw),
    );
    let pose = rear_axle_in_base_link.pose().compose(&lidar_in_rear_axle);
    PoseDocument {
        x_m: pose.x_m,
        y_m: pose.y_m,
        yaw_rad: pose.yaw_rad,
    }
}

/// The document of a change or fault.
pub fn change_document(change: &Change) -> ChangeDocument {
    ChangeDocument {
        kind: match change.kind {
            ChangeKind::CalibrationChanged => document::ChangeKind::CalibrationChanged,
            ChangeKind::CalibrationConfirmed => document::ChangeKind::CalibrationConfirmed,
            ChangeKind::Fault => document::ChangeKind::Fault,
        },
        cause: match change.cause {
            Cause::Steering => ChangeCause::Steering,
            Cause::LidarMount => ChangeCause::LidarMount,
            Cause::Vehicle => ChangeCause::Vehicle,
            Cause::Odometry => ChangeCause::Odometry,
            Cause::Unknown => ChangeCause::Unknown,
        },
        time_s: change.time_s,
        onset_s: change.onset_s,
        stamp_ns: change.stamp.0,
        change: change
            .change
            .iter()
            .map(|(parameter, by)| (name(*parameter), *by))
            .collect(),
    }
}

/// What `fleetcal calibrate` prints of a calibrator that has seen the whole recording.
pub fn report(robot: &RobotId, calibrator: &Calibrator, timing: Timing) -> CalibrationReport {
    let estimate = calibrator.estimate();
    let segments = calibrator.segments();
    CalibrationReport {
        robot: robot.clone(),
        vehicle: vehicle_document(&calibrator.config().vehicle),
        duration_s: calibrator.duration_s(),
        distance_m: estimate.distance_m,
        drive_samples: estimate.counts.drive_samples,
        scans: estimate.counts.scans,
        scans_rejected: estimate.counts.scans_rejected,
        parameters: parameters(&estimate.parameters),
        consistency: consistency(&estimate.consistency),
        events: calibrator.changes().iter().map(change_document).collect(),
        segments: segments.iter().map(segment).collect(),
        timing,
    }
}

/// The document of a vehicle.
pub fn vehicle_document(vehicle: &Vehicle) -> VehicleDocument {
    VehicleDocument {
        model: match vehicle.model {
            VehicleModel::Bicycle => document::VehicleModel::Bicycle,
            VehicleModel::Tricycle => document::VehicleModel::Tricycle,
        },
        wheelbase_m: vehicle.wheelbase_m,
    }
}

/// Whether every number of a document is finite. JSON has no other, and a filter that says another
/// has failed.
pub fn is_finite(document: &EstimateDocument) -> bool {
    let mut parameters = document.parameters.iter();
    parameters.all(|(_, parameter)| parameter.value.is_finite() && parameter.sigma.is_finite())
        && document.consistency.nis_mean.is_finite()
        && document.distance_m.is_finite()
}

fn segment(segment: &estimate::Segment) -> document::Segment {
    document::Segment {
        from_s: segment.from_s,
        to_s: segment.to_s,
        parameters: parameters(&segment.parameters),
    }
}

fn consistency(consistency: &estimate::Consistency) -> Consistency {
    Consistency {
        nis_mean: consistency.nis_mean,
        nis_dof: consistency.nis_dof,
        samples: consistency.samples,
    }
}

fn parameters(estimates: &[ParameterEstimate; 8]) -> Parameters {
    let [offset, x, y, yaw, scale, wheelbase, time, gain] = estimates;
    Parameters {
        steering_offset: parameter(ParameterName::SteeringOffset, offset),
        lidar_x: parameter(ParameterName::LidarX, x),
        lidar_y: parameter(ParameterName::LidarY, y),
        lidar_yaw: parameter(ParameterName::LidarYaw, yaw),
        speed_scale: parameter(ParameterName::SpeedScale, scale),
        wheelbase: parameter(ParameterName::Wheelbase, wheelbase),
        time_offset: parameter(ParameterName::TimeOffset, time),
        steering_gain: parameter(ParameterName::SteeringGain, gain),
    }
}

fn parameter(name: ParameterName, estimate: &ParameterEstimate) -> ParameterDocument {
    ParameterDocument {
        value: estimate.value,
        sigma: estimate.sigma,
        unit: name.unit(),
        status: match estimate.status {
            Status::Converged => ParameterStatus::Converged,
            Status::Learning => ParameterStatus::Learning,
            Status::Unobservable => ParameterStatus::Unobservable,
            Status::Fixed => ParameterStatus::Fixed,
            Status::Off => ParameterStatus::Off,
        },
        needs: estimate.needs.clone(),
    }
}

fn name(parameter: Parameter) -> ParameterName {
    match parameter {
        Parameter::SteeringOffset => ParameterName::SteeringOffset,
        Parameter::LidarX => ParameterName::LidarX,
        Parameter::LidarY => ParameterName::LidarY,
        Parameter::LidarYaw => ParameterName::LidarYaw,
        Parameter::SpeedScale => ParameterName::SpeedScale,
        Parameter::Wheelbase => ParameterName::Wheelbase,
        Parameter::TimeOffset => ParameterName::TimeOffset,
        Parameter::SteeringGain => ParameterName::SteeringGain,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_units_and_order_are_those_of_the_estimator() {
        for (parameter, in_documents) in Parameter::ALL.into_iter().zip(ParameterName::ALL) {
            assert_eq!(name(parameter), in_documents);
            assert_eq!(parameter.name(), in_documents.as_str());
            let unit = serde_json::to_value(in_documents.unit()).expect("a string");
            assert_eq!(unit, parameter.unit());
        }
    }
}
