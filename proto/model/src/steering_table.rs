//! Steering table: the curve of a steering as controllers take it.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

/// Status of a steering table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum SteeringTableStatus {
    /// No point is published: the steering offset is not `converged`, or no turn was driven yet.
    #[default]
    NotKnown,
    /// For information: each point is as good as its own sigma.
    Informative,
    /// Points on both sides, each with a sigma inside the limit of the steering offset.
    Converged,
}

/// One point of a steering table.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SteeringPoint {
    /// Angle that the steering sensor shows, rad, left positive.
    pub measured_rad: f64,
    /// Angle of the wheel, rad, left positive.
    pub true_rad: f64,
    /// Standard deviation of `true_rad`, rad.
    pub sigma_rad: f64,
}

/// True steering angle at measured angles, between the farthest ones that the robot has driven: there is no
/// point beyond. Forwards and backwards the curve is the same.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SteeringTable {
    /// Status of the whole table.
    pub status: SteeringTableStatus,
    /// Motion or setting that would add points, in words; absent if none is missing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false))]
    pub needs: Option<String>,
    /// Points by their measured angle, from the right to the left, 4° apart at most on a side of up to 80°: the
    /// zero, and those of each side that was driven.
    pub points: Vec<SteeringPoint>,
}

impl SteeringTable {
    /// Makes a table without a point, with the motion that is missing.
    pub fn not_known(needs: Option<String>) -> Self {
        Self {
            needs,
            ..Self::default()
        }
    }

    /// Returns the table if it has points.
    pub fn known(&self) -> Option<&Self> {
        (self.status != SteeringTableStatus::NotKnown).then_some(self)
    }

    /// True if all numbers are finite angles within a turn, with sigmas that are not negative, and the measured
    /// ones grow.
    pub fn is_sound(&self) -> bool {
        let turn = -TAU..=TAU;
        let mut points = self.points.iter();
        let mut pairs = self.points.windows(2);
        points.all(|point| {
            turn.contains(&point.measured_rad)
                && turn.contains(&point.true_rad)
                && (0.0..=TAU).contains(&point.sigma_rad)
        }) && pairs.all(|pair| pair[0].measured_rad < pair[1].measured_rad)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_has_the_documented_names() {
        let point = SteeringPoint {
            measured_rad: -0.5,
            true_rad: -0.25,
            sigma_rad: 0.125,
        };
        let table = SteeringTable {
            status: SteeringTableStatus::Informative,
            needs: None,
            points: vec![point],
        };
        let text = concat!(
            r#"{"status":"informative","points":"#,
            r#"[{"measured_rad":-0.5,"true_rad":-0.25,"sigma_rad":0.125}]}"#
        );
        assert_eq!(serde_json::to_string(&table).unwrap(), text);
        assert_eq!(serde_json::from_str::<SteeringTable>(text).unwrap(), table);
        assert_eq!(table.known(), Some(&table));
        let unknown = SteeringTable::not_known(Some("a turn".to_owned()));
        let json = serde_json::to_value(&unknown).unwrap();
        assert_eq!(
            (&json["status"], &json["needs"]),
            (&"not_known".into(), &"a turn".into())
        );
        assert_eq!(unknown.known(), None);
    }

    #[test]
    fn a_table_of_other_numbers_is_found() {
        let of = |points: &[[f64; 3]]| {
            let points = points
                .iter()
                .map(|[measured_rad, true_rad, sigma_rad]| SteeringPoint {
                    measured_rad: *measured_rad,
                    true_rad: *true_rad,
                    sigma_rad: *sigma_rad,
                });
            SteeringTable {
                points: points.collect(),
                ..SteeringTable::default()
            }
        };
        assert!(of(&[]).is_sound() && of(&[[-0.1, -0.1, 0.0], [0.1, 0.1, 0.1]]).is_sound());
        for points in [
            [[0.1, 0.0, 0.1], [-0.1, 0.0, 0.1]],
            [[0.1, 0.0, 0.1], [0.1, 0.0, 0.1]],
            [[-0.1, f64::NAN, 0.1], [0.1, 0.0, 0.1]],
            [[-0.1, 0.0, 0.1], [0.1, 0.0, -0.1]],
            [[-0.1, 0.0, 0.1], [0.1, 1e300, 0.1]],
        ] {
            assert!(!of(&points).is_sound(), "{points:?}");
        }
    }
}
