//! Published documents made of an estimator's results.

use fleetcal_domain::robot::{CheckFinding, Mount};
use fleetcal_estimator::Vehicle;
use fleetcal_estimator::calibrator::Calibrator;
use fleetcal_estimator::estimate::{self, Change, Estimate, ParameterEstimate, ParameterEstimates};
use fleetcal_model::{Motions, Parameter, ParameterStatus, Pose2, RobotId, SteeringTable};
use fleetcal_proto::estimate::{
    self as document, CalibrationReport, ChangeDocument, EstimateDocument, ParameterDocument,
    Parameters, Timing, VehicleDocument,
};

/// Makes the document of an estimate.
pub fn estimate_document(robot: &RobotId, estimate: &Estimate) -> EstimateDocument {
    EstimateDocument {
        robot: robot.clone(),
        stamp_ns: estimate.stamp,
        time_s: estimate.time_s,
        distance_m: estimate.distance_m,
        parameters: parameters(&estimate.parameters),
        reassembly_open: estimate.reassembly_open,
        covariance: Some(estimate.covariance),
        steering_table: Some(estimate.steering_table.clone()),
        detection: Some(estimate.detection),
        consistency: estimate.consistency,
        counts: estimate.counts,
        motions: None,
        lidar_in_base_link: None,
        estimated_by: None,
    }
}

/// Makes the document of the motions that a calibrator's estimate rests on.
pub fn motions(calibrator: &Calibrator) -> Motions {
    let driven = calibrator.excitation();
    Motions {
        left_m: driven.left_m,
        straight_m: driven.straight_m,
        right_m: driven.right_m,
        reverse_m: driven.reverse_m,
    }
}

/// Returns the LiDAR's pose in `base_link`, given the configured pose of the rear axle in it.
pub fn lidar_in_base_link(rear_axle_in_base_link: &Mount, of: &Parameters) -> Pose2 {
    let value = |name| of.get(name).value;
    let lidar_in_rear_axle = Pose2::new(
        value(Parameter::LidarX),
        value(Parameter::LidarY),
        value(Parameter::LidarYaw),
    );
    rear_axle_in_base_link.pose().compose(&lidar_in_rear_axle)
}

/// Makes the document of a change or fault.
pub fn change_document(change: &Change) -> ChangeDocument {
    ChangeDocument {
        kind: change.kind,
        cause: change.cause,
        time_s: change.time_s,
        onset_s: change.onset_s,
        stamp_ns: change.stamp,
        change: change.change.iter().copied().collect(),
    }
}

/// Makes the report that `fleetcal calibrate` prints of a calibrator that has processed the whole
/// recording.
pub fn report(robot: &RobotId, calibrator: &Calibrator, timing: Timing) -> CalibrationReport {
    let estimate = calibrator.estimate();
    let segments = calibrator.segments();
    CalibrationReport {
        schema_version: CalibrationReport::SCHEMA_VERSION,
        robot: robot.clone(),
        vehicle: vehicle_document(&calibrator.config().vehicle),
        description: None,
        duration_s: calibrator.duration_s(),
        distance_m: estimate.distance_m,
        drive_samples: estimate.counts.drive_samples,
        scans: estimate.counts.scans,
        scans_rejected: estimate.counts.scans_rejected,
        parameters: parameters(&estimate.parameters),
        covariance: estimate.covariance,
        sigma_terms: calibrator.sigma_terms(),
        steering_table: estimate.steering_table,
        detection: estimate.detection,
        consistency: estimate.consistency,
        events: calibrator.changes().iter().map(change_document).collect(),
        segments: segments.iter().map(segment).collect(),
        timing,
    }
}

/// Makes the document of a vehicle.
pub fn vehicle_document(vehicle: &Vehicle) -> VehicleDocument {
    VehicleDocument {
        model: vehicle.model,
        wheelbase_m: vehicle.wheelbase_m,
    }
}

/// Lets an estimate give way to a finding with which none of its values can be right: nothing is
/// converged, and what is needed is what the check says.
pub fn give_way(document: &mut EstimateDocument, finding: &CheckFinding) {
    let needs = format!("joining check of {}: {}", finding.check, finding.seen);
    for parameter in document.parameters.iter_mut() {
        if parameter.status == ParameterStatus::Converged {
            parameter.status = ParameterStatus::Learning;
        }
        if matches!(
            parameter.status,
            ParameterStatus::Learning | ParameterStatus::Unobservable
        ) {
            parameter.needs = Some(needs.clone());
        }
    }
    if let Some(table) = document.steering_table.as_mut() {
        *table = SteeringTable::not_known(Some(needs));
    }
}

/// True if every number of a document is finite. JSON has only finite numbers, and a filter with
/// any other has failed.
pub fn is_finite(document: &EstimateDocument) -> bool {
    let mut parameters = document.parameters.iter();
    parameters.all(|(_, parameter)| parameter.value.is_finite() && parameter.sigma.is_finite())
        && document
            .covariance
            .is_none_or(|covariance| covariance.is_finite())
        && document
            .steering_table
            .as_ref()
            .is_none_or(SteeringTable::is_sound)
        && document.consistency.is_finite()
        && document.distance_m.is_finite()
}

fn segment(segment: &estimate::Segment) -> document::Segment {
    document::Segment {
        from_s: segment.from_s,
        to_s: segment.to_s,
        parameters: parameters(&segment.parameters),
    }
}

fn parameters(estimates: &ParameterEstimates) -> Parameters {
    let [offset, x, y, yaw, scale, wheelbase, time, gain] = estimates;
    Parameters {
        steering_offset: parameter(Parameter::SteeringOffset, offset),
        lidar_x: parameter(Parameter::LidarX, x),
        lidar_y: parameter(Parameter::LidarY, y),
        lidar_yaw: parameter(Parameter::LidarYaw, yaw),
        speed_scale: parameter(Parameter::SpeedScale, scale),
        wheelbase: parameter(Parameter::Wheelbase, wheelbase),
        time_offset: parameter(Parameter::TimeOffset, time),
        steering_gain: parameter(Parameter::SteeringGain, gain),
    }
}

fn parameter(name: Parameter, estimate: &ParameterEstimate) -> ParameterDocument {
    ParameterDocument {
        value: estimate.value,
        sigma: estimate.sigma,
        unit: name.unit(),
        status: estimate.status,
        needs: estimate.needs.clone(),
    }
}
