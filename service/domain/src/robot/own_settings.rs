//! Settings of one robot's estimator.

use fleetcal_estimator::EstimatorSettings;
use fleetcal_estimator::settings::{Measurement, SettingsRefused};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Map, Value};

/// Key that stored robots may have and that is no longer accepted: the estimator has only one
/// measurement.
const FORMER: &str = "measurement";

/// Settings of one robot that differ from `[estimator]`: the given keys, each checked to be valid.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(transparent)]
pub struct OwnSettings(Map<String, Value>);

impl OwnSettings {
    /// Overlays these settings on `usual`, which gives every other key.
    ///
    /// # Errors
    /// If the two contradict each other.
    pub fn over(&self, usual: &EstimatorSettings) -> Result<EstimatorSettings, SettingsRefused> {
        let settings = self.laid_over(usual);
        settings.check().map(|()| settings)
    }

    /// Settings in use by this robot's estimator. If `[estimator]` has come to contradict the
    /// robot's own settings, the program's defaults replace it.
    pub fn in_use(&self, usual: &EstimatorSettings) -> EstimatorSettings {
        let mut known = self.clone();
        known.0.remove(FORMER);
        known
            .over(usual)
            .unwrap_or_else(|_| known.laid_over(&EstimatorSettings::default()))
    }

    fn laid_over(&self, usual: &EstimatorSettings) -> EstimatorSettings {
        let Ok(mut settings) = serde_json::to_value(usual) else {
            return usual.clone();
        };
        lay(&Value::Object(self.0.clone()), &mut settings);
        // Each key was read as what it is before, and the usual ones were.
        serde_json::from_value(settings).unwrap_or_else(|_| usual.clone())
    }
}

impl<'de> Deserialize<'de> for OwnSettings {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let given = Map::deserialize(from)?;
        let mut alone: EstimatorSettings =
            serde_json::from_value(Value::Object(given.clone())).map_err(D::Error::custom)?;
        // Stored robots may name the paper's; who gives it is refused by `over`.
        alone.measurement = Measurement::default();
        alone.check().map_err(D::Error::custom)?;
        Ok(Self(given))
    }
}

/// Overlays every given value on the usual one, tables key by key.
fn lay(given: &Value, over: &mut Value) {
    match (given, over) {
        (Value::Null, _) => {}
        (Value::Object(given), Value::Object(over)) => {
            for (key, value) in given {
                lay(value, over.entry(key.clone()).or_insert(Value::Null));
            }
        }
        (given, over) => *over = given.clone(),
    }
}

#[cfg(test)]
mod tests {
    use fleetcal_estimator::settings::Freedom;

    use super::*;

    fn own(text: &str) -> OwnSettings {
        serde_json::from_str(text).unwrap()
    }

    #[test]
    fn one_key_of_a_robot_leaves_all_others_as_estimator_has_them() {
        let mut usual = EstimatorSettings::default();
        usual.converged_sigma.lidar_y = 0.02;
        usual.anchor_distance_m = 4.0;
        let robot = own(r#"{"converged_sigma": {"lidar_x": 0.01}, "false_alarm_hours": 500}"#);
        let mut expected = usual.clone();
        expected.converged_sigma.lidar_x = 0.01;
        expected.false_alarm_hours = 500.0;
        assert_eq!(robot.over(&usual), Ok(expected));
        assert_eq!(own("{}").over(&usual), Ok(usual));
    }

    #[test]
    fn a_stored_robot_of_a_former_version_has_every_key_and_keeps_it() {
        let before = EstimatorSettings {
            pose_sigma_m: 0.02,
            ..EstimatorSettings::default()
        };
        let stored = own(&serde_json::to_string(&before).unwrap());
        let usual = EstimatorSettings {
            anchor_distance_m: 4.0,
            ..EstimatorSettings::default()
        };
        assert_eq!(stored.over(&usual), Ok(before));
    }

    #[test]
    fn a_stored_robot_of_the_papers_filter_is_read_and_none_is_given_one() {
        let stored = own(r#"{"measurement": "anchored", "pose_sigma_m": 0.02}"#);
        let usual = EstimatorSettings {
            anchor_distance_m: 4.0,
            ..EstimatorSettings::default()
        };
        let expected = EstimatorSettings {
            pose_sigma_m: 0.02,
            ..usual.clone()
        };
        assert_eq!(stored.in_use(&usual), expected);
        assert_eq!(stored.over(&usual), Err(SettingsRefused::Anchored));
        let former_default = own(r#"{"measurement": "clone"}"#);
        assert_eq!(former_default.over(&usual), Ok(usual));
    }

    #[test]
    fn what_contradicts_the_settings_of_all_is_refused_and_never_in_use() {
        let gain = own(r#"{"free": {"steering_gain": "estimated"}}"#);
        let mut usual = EstimatorSettings::default();
        usual.free.wheelbase = Freedom::Estimated;
        assert_eq!(gain.over(&usual), Err(SettingsRefused::WheelbaseAndGain));
        let in_use = gain.in_use(&usual);
        assert_eq!(in_use.check(), Ok(()));
        assert_eq!(in_use.free.steering_gain, Freedom::Estimated);
        for refused in [
            r#"{"noize": 1}"#,
            r#"{"measurement": "cloned"}"#,
            r#"{"pose_sigma_m": -1}"#,
            r#"{"prior_sigma": {"lidar_z": 1}}"#,
        ] {
            assert!(
                serde_json::from_str::<OwnSettings>(refused).is_err(),
                "{refused}"
            );
        }
    }
}
