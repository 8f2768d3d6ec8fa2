//! Normal equations for pose and velocity from one pass over the points.

use nalgebra::{Matrix6, Vector6};

/// The normal equations of one pass over the points.
#[derive(Debug, Clone)]
pub struct NormalEquations {
    /// Information on pose and velocity.
    pub information: Matrix6<f64>,
    /// Minus the gradient.
    pub gradient: Vector6<f64>,
    /// Points on their line within its noise.
    pub on_map: f32,
    /// Sum of their squared residuals over their variances.
    pub chi2: f32,
}
