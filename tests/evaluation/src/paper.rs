//! The paper's own figures: metres and degrees, as printed.

/// Converged estimates: x (m), y (m), yaw (degrees), steering offset (degrees).
pub type Converged = [f64; 4];

/// Table I, from CAD values, unladen.
pub const UNLADEN_FROM_CAD: Converged = [0.43, 0.0046, 0.72, 0.92];
/// Table I, from CAD values, with 500 kg.
pub const LADEN_FROM_CAD: Converged = [0.44, 0.0055, 0.73, 0.92];
/// Table II, from zero, unladen.
pub const UNLADEN_FROM_ZERO: Converged = [0.43, 0.0052, 0.72, 0.91];
/// Table II, from zero, with 500 kg.
pub const LADEN_FROM_ZERO: Converged = [0.44, 0.0056, 0.73, 0.91];
/// The second platform.
pub const NANO: Converged = [0.2597, 0.0101, -1.29, -1.11];

/// Table III: induced steering offset (degrees), and the estimates.
pub const INDUCED: [(f64, Converged); 5] = [
    (-9.0, [0.4259, -0.0239, 0.67, -8.73]),
    (7.4, [0.4359, -0.0146, 0.79, 7.23]),
    (5.0, [0.4185, -0.0034, 0.88, 4.87]),
    (5.0, [0.4212, 0.0100, 0.81, 4.87]),
    (5.0, [0.4235, 0.0135, 0.66, 4.92]),
];

/// One set of Table IV.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RunSet {
    /// Estimates of the calibration run.
    pub calibrated: Converged,
    /// RMSE of the cross-track error in the calibration run, m.
    pub calibration_m: f64,
    /// RMSE with the estimated offset added once more, m.
    pub added_m: f64,
    /// RMSE with the estimated offset removed, m.
    pub removed_m: f64,
}

/// Table IV.
pub const RUN_SETS: [RunSet; 3] = [
    RunSet {
        calibrated: [0.4393, -0.0088, 0.71, -1.25],
        calibration_m: 0.14,
        added_m: 0.20,
        removed_m: 0.09,
    },
    RunSet {
        calibrated: [0.4356, -0.0158, 0.75, -0.41],
        calibration_m: 0.09,
        added_m: 0.10,
        removed_m: 0.07,
    },
    RunSet {
        calibrated: [0.4382, -0.0158, 0.76, 2.92],
        calibration_m: 0.071,
        added_m: 0.174,
        removed_m: 0.059,
    },
];

/// Last figure: RMSE against the filter's trajectory, uncompensated and compensated, m.
pub const ODOMETRY_MANUAL_M: (f64, f64) = (15.316, 1.359);
/// Same figures of the autonomous run, m.
pub const ODOMETRY_AUTONOMOUS_M: (f64, f64) = (14.02, 1.65);

/// A tenth of the worst error of an induced offset (0.27°), degrees.
pub const STEERING_BOUND_DEG: f64 = 0.03;
/// A tenth of the extrinsics' spread over the induced offsets (1.7 cm, 3.3 cm), m.
pub const POSITION_BOUND_M: f64 = 0.002;
/// A tenth of the yaw's spread over the induced offsets (0.22°), degrees.
pub const YAW_BOUND_DEG: f64 = 0.022;
