//! Errors of a scanner's ranges that come back in every scan.

/// Errors of a range that are the scanner's own.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RangeErrors {
    /// `b`, m.
    pub bias_m: f32,
    /// `c`, m.
    pub incidence_m: f32,
}

impl RangeErrors {
    /// Offset of points seen at an incidence of this cosine from their surface, along the normal
    /// that the cosine is signed by, m.
    #[inline]
    pub fn across_m(self, cos: f32) -> f32 {
        cos * (self.bias_m + self.incidence_m * (1.0 - cos.abs()))
    }
}
