//! A block: windows without a gap between them, as one.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use super::window::Window;
use crate::filter::constraint::ByParameters;
use crate::filter::{Values, apart, padded};
use crate::stream::RobotTime;

/// Mean squared residual of a block's windows beyond which the filter strays: five times the
/// expected one, with 30 degrees of freedom (15 in a half block). One wild window is enough.
const SURPRISE_MAX: f64 = 15.0;

/// Windows without a gap between them, as one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Block {
    end: RobotTime,
    /// The parameters that the residual is by. A checkpoint holds no unfinished block; one of an
    /// earlier estimator would not name them.
    #[serde(default, with = "padded")]
    values: Option<Values>,
    residual: Vector3<f64>,
    /// The residual by the parameters as they were known when each window was counted.
    #[serde(default)]
    residual_as_told: Vector3<f64>,
    /// Sum of the squared residuals of its windows, each as the filter expected it before the
    /// window.
    #[serde(default)]
    surprise: f64,
    /// Derivatives of the residual by the parameters.
    #[serde(deserialize_with = "padded::columns")]
    pub jacobian: ByParameters,
    /// Covariance of the motion, and of the pose at its beginning.
    pub covariance: Matrix3<f64>,
    /// Number of the windows.
    pub windows: usize,
}

impl Block {
    /// A block of one window, by these parameters.
    pub fn begin(window: &Window, values: &Values, surprise: f64) -> Self {
        let residual = window.residual + window.jacobian * apart(&window.values, values);
        Self {
            end: window.end,
            values: Some(*values),
            residual,
            residual_as_told: residual,
            surprise,
            jacobian: window.jacobian,
            covariance: window.covariance - window.end_covariance,
            windows: 1,
        }
    }

    /// Extends the block by a window: the LiDAR pose between two windows is in both and cancels.
    /// All windows are compared with the same parameters: while these are still found, they move by
    /// more than a block errs.
    pub fn extended(&self, window: &Window, values: &Values, surprise: f64) -> Option<Self> {
        let before = self.values.filter(|_| self.end == window.begin)?;
        let residual = self.residual + self.jacobian * apart(&before, values);
        let own = Self::begin(window, values, surprise);
        let carry = window.carry;
        Some(Self {
            residual: carry * residual + own.residual,
            residual_as_told: carry * self.residual_as_told + own.residual,
            surprise: self.surprise + surprise,
            jacobian: carry * self.jacobian + window.jacobian,
            covariance: carry * self.covariance * carry.transpose() + window.motion_covariance,
            windows: self.windows + 1,
            ..own
        })
    }

    /// Error of the block. A filter that its windows surprise strays, surer of itself than it may
    /// be: the motion of the parameters while the windows were counted is scatter then, too.
    pub fn error(&self) -> &Vector3<f64> {
        if self.surprise > SURPRISE_MAX * self.windows as f64 {
            &self.residual_as_told
        } else {
            &self.residual
        }
    }
}
