//! Joints that steer and drive, for messages that name joints or only number them.

use serde::{Deserialize, Serialize};

/// Longest name of a joint, bytes.
const NAME_BYTES_MAX: usize = 200;
/// Most wheels whose mean is the speed.
const WHEELS_MAX: usize = 8;
/// Largest radius of a wheel, m.
const WHEEL_RADIUS_MAX_M: f64 = 5.0;
/// Largest gear ratio, either way.
const GEAR_MAX: f64 = 1_000.0;

/// Joints that steer and drive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Joints {
    /// Joint whose position is the steering angle, left positive; the left one where
    /// `steering_right` is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false))]
    pub steering: Option<String>,
    /// Joint of the right wheel, where each of two steered wheels has its own: the angle is that of
    /// the virtual wheel between them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false))]
    pub steering_right: Option<String>,
    /// Steering angle of the (virtual) centre wheel for each radian of the joint; 1 unless given.
    #[serde(default = "one")]
    pub steering_gear: f64,
    /// Joints whose mean velocity is the speed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub wheels: Vec<String>,
    /// Radius of these wheels, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false))]
    pub wheel_radius_m: Option<f64>,
    /// Turns of the wheel for each turn of the joint; 1 unless given.
    #[serde(default = "one")]
    pub wheel_gear: f64,
}

fn one() -> f64 {
    1.0
}

/// Value of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointValue {
    /// Position, rad.
    Position,
    /// Velocity, rad/s.
    Velocity,
}

impl JointValue {
    /// Returns its name among the interfaces of `ros2_control`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::Velocity => "velocity",
        }
    }
}

/// Reason for which a message states no angle or no speed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Unstated {
    /// Messages of its type never do.
    ByType,
    /// The robot's joints are unknown.
    NoJoints,
    /// A joint is missing.
    Joint {
        /// Name of the joint.
        joint: String,
        /// Missing value.
        what: &'static str,
        /// True if the message has none of the joints that are needed: another one may.
        has_none: bool,
    },
    /// A field is empty.
    Field(&'static str),
}

impl Unstated {
    /// True if another message of the same topic may state it.
    pub fn may_follow(&self) -> bool {
        matches!(self, Self::Joint { has_none: true, .. })
    }
}

impl Joints {
    /// Returns the steering angle, rad, and the speed, m/s, by the values of joints that have names.
    pub fn wheels_by_name(
        joints: Option<&Self>,
        value: impl Fn(&str, JointValue) -> Option<f64>,
    ) -> (Result<f64, Unstated>, Result<f64, Unstated>) {
        let value_of = |names: &[&str], of: JointValue| {
            let values: Vec<Option<f64>> = names.iter().map(|name| value(name, of)).collect();
            let Some(missing) = values.iter().position(Option::is_none) else {
                return Ok(values.into_iter().flatten().collect::<Vec<f64>>());
            };
            Err(Unstated::Joint {
                joint: names.get(missing).copied().unwrap_or_default().to_owned(),
                what: of.name(),
                has_none: values.iter().all(Option::is_none),
            })
        };
        let steering = joints.and_then(Self::steering_names);
        let steering = steering.ok_or(Unstated::NoJoints).and_then(|names| {
            let angles = value_of(&names, JointValue::Position)?;
            Ok(Self::angle_rad(joints, &angles))
        });
        let speed = joints.filter(|of| !of.wheels.is_empty() && of.wheel_radius_m.is_some());
        let speed = speed.ok_or(Unstated::NoJoints).and_then(|of| {
            let names: Vec<&str> = of.wheels.iter().map(String::as_str).collect();
            Self::speed_mps(joints, &value_of(&names, JointValue::Velocity)?)
        });
        (steering, speed)
    }

    fn steering_names(&self) -> Option<Vec<&str>> {
        let left = self.steering.as_deref()?;
        Some(
            [Some(left), self.steering_right.as_deref()]
                .into_iter()
                .flatten()
                .collect(),
        )
    }

    /// Returns the angle of the (virtual) centre wheel, rad, by the position of its joint or those
    /// of a left and a right wheel.
    pub fn angle_rad(joints: Option<&Self>, positions_rad: &[f64]) -> f64 {
        let gear = joints.map_or(1.0, |of| of.steering_gear);
        match *positions_rad {
            [left, right] => centre_rad(gear * left, gear * right),
            [only, ..] => gear * only,
            [] => 0.0,
        }
    }

    /// Returns the mean speed of the wheels, m/s.
    ///
    /// # Errors
    /// The radius of the wheels is unknown.
    pub fn speed_mps(joints: Option<&Self>, velocities_radps: &[f64]) -> Result<f64, Unstated> {
        let of = joints.ok_or(Unstated::NoJoints)?;
        let radius_m = of.wheel_radius_m.ok_or(Unstated::NoJoints)?;
        let mut sum_radps = 0.0;
        for velocity in velocities_radps {
            sum_radps += velocity;
        }
        Ok(radius_m * of.wheel_gear * sum_radps / velocities_radps.len().max(1) as f64)
    }

    /// Checks names, gears and the radius.
    ///
    /// # Errors
    /// One sentence: the key, its value and the accepted values.
    pub fn check(&self) -> Result<(), String> {
        let names = self.wheels.iter().chain(&self.steering);
        if let Some(name) = names
            .chain(&self.steering_right)
            .find(|name| name.is_empty() || name.len() > NAME_BYTES_MAX)
        {
            return Err(format!(
                "streams.joints has a joint {name:?}, expected names of 1 to 200 bytes"
            ));
        }
        if self.steering.is_none()
            && let Some(right) = &self.steering_right
        {
            return Err(format!(
                "streams.joints.steering_right: got {right:?} without steering, expected the left \
                 wheel's joint there"
            ));
        }
        if self.wheels.len() > WHEELS_MAX {
            let wheels = self.wheels.len();
            return Err(format!(
                "streams.joints.wheels: got {wheels} wheels, expected 8 at most"
            ));
        }
        check_gear("streams.joints.steering_gear", self.steering_gear)?;
        check_gear("streams.joints.wheel_gear", self.wheel_gear)?;
        let radius = self.wheel_radius_m;
        let usable = radius.is_some_and(|metres| metres > 0.0 && metres <= WHEEL_RADIUS_MAX_M);
        if usable || (radius.is_none() && self.wheels.is_empty()) {
            return Ok(());
        }
        let given = radius.map_or_else(|| "nothing".to_owned(), |metres| metres.to_string());
        Err(format!(
            "streams.joints.wheel_radius_m: got {given}, expected more than 0 and at most 5 m"
        ))
    }
}

/// Units of steering and speed in a robot's messages, whatever their type.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Units {
    /// Steering angle of the (virtual) centre wheel, rad, left positive, for each unit of the
    /// message beyond `steering_zero`.
    pub steering_gear: Option<f64>,
    /// Steering in the message when the vehicle drives straight ahead by its drawing.
    pub steering_zero: Option<f64>,
    /// Speed, m/s, for each unit of the message.
    pub speed_gear: Option<f64>,
}

impl Units {
    /// True if messages are in radians and metres a second.
    pub fn are_usual(&self) -> bool {
        *self == Self::default()
    }

    /// Returns the steering angle, rad, of a message that states `sent`.
    pub fn steering_rad(&self, sent: f64) -> f64 {
        let sent = self.steering_zero.map_or(sent, |zero| sent - zero);
        self.steering_gear.map_or(sent, |gear| gear * sent)
    }

    /// Returns the speed, m/s, of a message that states `sent`.
    pub fn speed_mps(&self, sent: f64) -> f64 {
        self.speed_gear.map_or(sent, |gear| gear * sent)
    }

    /// Checks gears and zero.
    ///
    /// # Errors
    /// One sentence: the key, its value and the accepted values.
    pub fn check(&self) -> Result<(), String> {
        check_gear("streams.steering_gear", self.steering_gear.unwrap_or(1.0))?;
        check_gear("streams.speed_gear", self.speed_gear.unwrap_or(1.0))?;
        match self.steering_zero {
            Some(zero) if !zero.is_finite() => Err(format!(
                "streams.steering_zero: got {zero}, expected a finite number"
            )),
            _ => Ok(()),
        }
    }
}

/// Checks a gear: a finite ratio other than 0.
fn check_gear(key: &str, gear: f64) -> Result<(), String> {
    if gear.is_finite() && gear != 0.0 && gear.abs() <= GEAR_MAX {
        return Ok(());
    }
    Err(format!(
        "{key}: got {gear}, expected a ratio other than 0, up to 1000 either way"
    ))
}

/// Returns the angle of the virtual wheel midway between a left and a right one, rad.
///
/// Ackermann's condition is `cot left = cot centre - k` and `cot right = cot centre + k`, with half
/// the track over the wheelbase `k`. So with the mean `m` and half the difference `e` of the two
/// tangents, `tan centre = m - e^2 / m`, whatever `k`. Since `e <= m^2` on every vehicle whose track
/// is at most two wheelbases, more than that is toe or backlash, which is left out: near straight
/// ahead it would be divided by zero.
fn centre_rad(left_rad: f64, right_rad: f64) -> f64 {
    let (left, right) = (left_rad.tan(), right_rad.tan());
    let mean = 0.5 * (left + right);
    if mean == 0.0 {
        return 0.0;
    }
    let most = mean * mean;
    let half = (0.5 * (left - right)).clamp(-most, most);
    (mean - half * half / mean).atan()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_wheel_between_two_turns_as_the_vehicle_does() {
        let (track_m, wheelbase_m) = (0.9, 1.2);
        for curvature in [-0.6, -0.2, -1e-3, 0.0, 1e-3, 0.05, 0.4, 0.6_f64] {
            let radius_of = |lateral_m: f64| curvature / (1.0 - lateral_m * curvature);
            let left = (wheelbase_m * radius_of(track_m / 2.0)).atan();
            let right = (wheelbase_m * radius_of(-track_m / 2.0)).atan();
            let centre = (wheelbase_m * curvature).atan();
            assert!(
                (centre_rad(left, right) - centre).abs() < 1e-12,
                "{curvature}"
            );
            // Joints in the other order tell the same.
            assert!((centre_rad(right, left) - centre).abs() < 1e-12);
        }
        // Toe of half a degree moves nothing near straight ahead.
        for mean in [-0.02, -1e-4, 0.0, 1e-4, 0.02_f64] {
            let centre = centre_rad(mean + 0.009, mean - 0.009);
            assert!((centre - mean).abs() < 1e-5, "{mean}: {centre}");
        }
    }
}
