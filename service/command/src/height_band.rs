//! The flag of the heights that are taken of a 3D scanner's clouds.

use std::str::FromStr;

use fleetcal_estimator::point_cloud::{BandFields, PlanarBand};

/// A band in the form of a flag: two heights in the LiDAR's frame, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeightBand(PlanarBand);

impl HeightBand {
    /// Returns `configured`, with the heights of the flag if it is given.
    pub fn or_of(flag: Option<Self>, configured: PlanarBand) -> PlanarBand {
        flag.map_or(configured, |Self(heights)| {
            configured.with_heights_of(&heights)
        })
    }
}

impl FromStr for HeightBand {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let heights = text.split_once(',').and_then(|(min, max)| {
            let height = |text: &str| text.trim().parse().ok();
            Some((height(min)?, height(max)?))
        });
        let Some((height_min_m, height_max_m)) = heights else {
            return Err("expected two heights in metres, the lower first".to_owned());
        };
        let fields = BandFields {
            height_min_m,
            height_max_m,
            ..BandFields::default()
        };
        PlanarBand::try_from(fields)
            .map(Self)
            .map_err(|refused| refused.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_band_is_two_heights() {
        let flag: HeightBand = "-0.2,1.5".parse().expect("two heights");
        let configured = BandFields {
            beams: Some(720),
            ..BandFields::default()
        };
        let configured = PlanarBand::try_from(configured).expect("a band");
        let band = BandFields::from(HeightBand::or_of(Some(flag), configured));
        assert_eq!(band.beams, Some(720));
        assert!(band.height_min_m < -0.19 && band.height_max_m > 1.49);
        assert_eq!(HeightBand::or_of(None, configured), configured);
        for (text, wanted) in [
            ("", "two heights"),
            ("1", "two heights"),
            ("1,2,3", "two heights"),
            ("low,high", "two heights"),
            (
                "1,0",
                "height_max_m: got 0, expected more than height_min_m",
            ),
            ("nan,0", "height_min_m: got NaN"),
        ] {
            let reason = text.parse::<HeightBand>().expect_err(text);
            assert!(reason.contains(wanted), "{reason}");
        }
    }
}
