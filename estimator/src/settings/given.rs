//! Tables with one key a parameter, of which a user may give as few as they want to change.

use serde::{Deserialize, Deserializer};

use super::{EstimatorSettings, Freedom, PerParameter};

/// The keys that were given.
#[derive(Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Given<T> {
    steering_offset: Option<T>,
    lidar_x: Option<T>,
    lidar_y: Option<T>,
    lidar_yaw: Option<T>,
    speed_scale: Option<T>,
    wheelbase: Option<T>,
    time_offset: Option<T>,
    steering_gain: Option<T>,
}

impl<T> Default for Given<T> {
    fn default() -> Self {
        Self {
            steering_offset: None,
            lidar_x: None,
            lidar_y: None,
            lidar_yaw: None,
            speed_scale: None,
            wheelbase: None,
            time_offset: None,
            steering_gain: None,
        }
    }
}

/// Given values, and the default of every key that was not given.
fn over<'de, D, T>(
    from: D,
    table: fn(EstimatorSettings) -> PerParameter<T>,
) -> Result<PerParameter<T>, D::Error>
where
    D: Deserializer<'de>,
    T: Deserialize<'de>,
{
    let given = Given::deserialize(from)?;
    let usual = table(EstimatorSettings::default());
    Ok(PerParameter {
        steering_offset: given.steering_offset.unwrap_or(usual.steering_offset),
        lidar_x: given.lidar_x.unwrap_or(usual.lidar_x),
        lidar_y: given.lidar_y.unwrap_or(usual.lidar_y),
        lidar_yaw: given.lidar_yaw.unwrap_or(usual.lidar_yaw),
        speed_scale: given.speed_scale.unwrap_or(usual.speed_scale),
        wheelbase: given.wheelbase.unwrap_or(usual.wheelbase),
        time_offset: given.time_offset.unwrap_or(usual.time_offset),
        steering_gain: given.steering_gain.unwrap_or(usual.steering_gain),
    })
}

type Numbers = PerParameter<f64>;

pub(super) fn free<'de, D: Deserializer<'de>>(from: D) -> Result<PerParameter<Freedom>, D::Error> {
    over(from, |usual| usual.free)
}

pub(super) fn prior_sigma<'de, D: Deserializer<'de>>(from: D) -> Result<Numbers, D::Error> {
    over(from, |usual| usual.prior_sigma)
}

pub(super) fn drift_per_sqrt_hour<'de, D: Deserializer<'de>>(from: D) -> Result<Numbers, D::Error> {
    over(from, |usual| usual.drift_per_sqrt_hour)
}

pub(super) fn systematic_sigma<'de, D: Deserializer<'de>>(from: D) -> Result<Numbers, D::Error> {
    over(from, |usual| usual.systematic_sigma)
}

pub(super) fn converged_sigma<'de, D: Deserializer<'de>>(from: D) -> Result<Numbers, D::Error> {
    over(from, |usual| usual.converged_sigma)
}

pub(super) fn physical_limit<'de, D: Deserializer<'de>>(from: D) -> Result<Numbers, D::Error> {
    over(from, |usual| usual.physical_limit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_with_one_key_leaves_the_others_at_their_defaults() {
        let given = r#"{"converged_sigma": {"lidar_x": 0.01}, "free": {"wheelbase": "estimated"}}"#;
        let settings: EstimatorSettings = serde_json::from_str(given).unwrap();
        let mut expected = EstimatorSettings::default();
        expected.converged_sigma.lidar_x = 0.01;
        expected.free.wheelbase = Freedom::Estimated;
        assert_eq!(settings, expected);
    }

    #[test]
    fn an_unknown_key_is_refused_by_name() {
        let given = r#"{"prior_sigma": {"lidar_z": 0.01}}"#;
        let refused = serde_json::from_str::<EstimatorSettings>(given).unwrap_err();
        assert!(refused.to_string().contains("lidar_z"), "{refused}");
    }
}
