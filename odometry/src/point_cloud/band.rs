//! Band of heights that is used of a cloud.

use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use crate::field::FieldRefused;
use crate::scan::BEAMS_MAX;

/// Farthest height of a band from the LiDAR, m.
const HEIGHT_MAX_M: f64 = 50.0;
/// Farthest range, m.
const RANGE_MAX_M: f64 = 300.0;
/// Fewest beams of a turn.
const BEAMS_MIN: usize = 90;

/// The band of heights that makes a planar scan, and how it is made. Checked.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(try_from = "BandFields", into = "BandFields")]
pub struct PlanarBand(BandFields);

/// The band of heights in the LiDAR's frame that makes a planar scan of a cloud. Heights are z, up.
// The keys of a `PlanarBand` in a configuration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = PlanarBand))]
pub struct BandFields {
    /// Lowest height taken, m; −0.5 unless given.
    #[cfg_attr(feature = "openapi", schema(required = false, minimum = -50.0, maximum = 50.0))]
    pub height_min_m: f64,
    /// Highest height taken, m; 0.5 unless given.
    #[cfg_attr(feature = "openapi", schema(required = false, minimum = -50.0, maximum = 50.0))]
    pub height_max_m: f64,
    /// Smallest range of a point in the plane, m; nearer is the robot itself. 0.3 unless given.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, minimum = 0.0, maximum = 300.0)
    )]
    pub range_min_m: f64,
    /// Largest range of a point in the plane, m; farther points are left out. 60 unless given.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, minimum = 0.0, maximum = 300.0)
    )]
    pub range_max_m: f64,
    /// Largest distance of a point of the floor or the ceiling from it, m; 0.1 unless given.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, minimum = 0.0, maximum = 1.0)
    )]
    pub clearance_m: f64,
    /// Beams of a whole turn; as many as the cloud has columns unless given, else 1024.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false, minimum = 90, maximum = 16384, value_type = Option<u32>))]
    pub beams: Option<usize>,
    /// Treats all points as measured at the stamp, whatever their times: for a cloud that was
    /// deskewed before.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub ignore_times: bool,
}

impl Default for BandFields {
    fn default() -> Self {
        Self {
            height_min_m: -0.5,
            height_max_m: 0.5,
            range_min_m: 0.3,
            range_max_m: 60.0,
            clearance_m: 0.1,
            beams: None,
            ignore_times: false,
        }
    }
}

impl From<PlanarBand> for BandFields {
    fn from(band: PlanarBand) -> Self {
        band.0
    }
}

impl TryFrom<BandFields> for PlanarBand {
    type Error = FieldRefused;

    fn try_from(fields: BandFields) -> Result<Self, FieldRefused> {
        let refused = |field, value: f64, accepted| Err(FieldRefused::new(field, value, accepted));
        let heights = -HEIGHT_MAX_M..=HEIGHT_MAX_M;
        if !heights.contains(&fields.height_min_m) {
            return refused("height_min_m", fields.height_min_m, "-50 to 50 m");
        }
        if !heights.contains(&fields.height_max_m) || fields.height_max_m <= fields.height_min_m {
            let accepted = "more than height_min_m and at most 50 m";
            return refused("height_max_m", fields.height_max_m, accepted);
        }
        if !(0.0..RANGE_MAX_M).contains(&fields.range_min_m) {
            return refused("range_min_m", fields.range_min_m, "0 to 300 m");
        }
        if !(fields.range_max_m > fields.range_min_m && fields.range_max_m <= RANGE_MAX_M) {
            let accepted = "more than range_min_m and at most 300 m";
            return refused("range_max_m", fields.range_max_m, accepted);
        }
        if !(0.0..=1.0).contains(&fields.clearance_m) {
            return refused("clearance_m", fields.clearance_m, "0 to 1 m");
        }
        match fields.beams {
            Some(beams) if !(BEAMS_MIN..=BEAMS_MAX).contains(&beams) => {
                Err(FieldRefused::new("beams", beams, "90 to 16384"))
            }
            _ => Ok(Self(fields)),
        }
    }
}

impl PlanarBand {
    /// The same band between the heights of another.
    #[must_use]
    pub fn with_heights_of(self, other: &Self) -> Self {
        Self(BandFields {
            height_min_m: other.0.height_min_m,
            height_max_m: other.0.height_max_m,
            ..self.0
        })
    }

    pub(super) fn height_m(&self) -> RangeInclusive<f64> {
        self.0.height_min_m..=self.0.height_max_m
    }

    pub(super) fn range_m(&self) -> RangeInclusive<f64> {
        self.0.range_min_m..=self.0.range_max_m
    }

    pub(super) fn clearance_m(&self) -> f64 {
        self.0.clearance_m
    }

    pub(super) fn beams(&self) -> Option<usize> {
        self.0.beams
    }

    pub(super) fn ignores_times(&self) -> bool {
        self.0.ignore_times
    }
}
