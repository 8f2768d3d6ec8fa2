//! Configuration that a robot's own description implies.

use fleetcal_description::{LidarMount, Proposal, Underivable};
use fleetcal_estimator::vehicle::SpeedMeasuredAt;
use fleetcal_estimator::{Pose2, VehicleModel};
use fleetcal_proto::description::{DescribedValue, DescriptionDocument};
use serde::Serialize;
use serde_json::{Value, json};

use super::config::{Mount, RobotConfig, Wheelbase};
use crate::streams::{Joints, RobotStreams, StreamsFields};

/// Relative difference from which two lengths contradict each other.
const LENGTHS_APART: f64 = 0.01;
/// Distance from which two poses contradict each other, m.
const POSES_APART_M: f64 = 0.02;
/// Turn from which two poses contradict each other, rad: one degree.
const POSES_APART_RAD: f64 = 0.017_5;

/// Configuration by a robot's description, as far as it can be derived.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DescribedConfig {
    /// Steering of the vehicle.
    pub model: Option<VehicleModel>,
    /// Place of the speed measurement, where it is not that of the model.
    pub speed_measured_at: Option<SpeedMeasuredAt>,
    /// Distance between the axles.
    pub wheelbase_m: Option<Wheelbase>,
    /// Joints that steer and drive.
    pub joints: Option<Joints>,
    /// Pose of the LiDAR in `base`.
    pub nominal_extrinsics: Option<Mount>,
    /// Pose of the rear axle in `base_link`.
    pub rear_axle_in_base_link: Option<Mount>,
    values: Vec<DescribedValue>,
    missing: Vec<Missing>,
    remarks: Vec<String>,
}

/// Values that one reason keeps from being derived.
#[derive(Debug, Clone, PartialEq)]
struct Missing {
    keys: Vec<String>,
    /// `got …, expected …`.
    reason: String,
}

impl DescribedConfig {
    /// Takes what a proposal has.
    pub fn of(proposal: &Proposal) -> Self {
        let mut own = Self {
            remarks: proposal.remarks.clone(),
            ..Self::default()
        };
        if let Some((layout, source)) = own.derived(&proposal.layout) {
            own.model = Some(layout.model());
            own.speed_measured_at = layout.speed_measured_at();
            own.add("model", layout.model(), source.clone());
            own.add("speed_measured_at", own.speed_place(), source);
        }
        if let Some((metres, source)) = own.derived(&proposal.wheelbase_m) {
            let metres = in_digits(metres);
            own.wheelbase_m = own.accepted(Wheelbase::try_from(metres));
            own.add("wheelbase_m", metres, source);
        }
        if let Some((metres, source)) = own.derived(&proposal.track_m) {
            own.add("track_m", in_digits(metres), source);
        }
        own.take_joints(proposal);
        if let Some((pose, source)) = own.derived(&proposal.rear_axle_in_base_link) {
            let pose = pose_in_digits(pose);
            own.rear_axle_in_base_link = own.accepted(Mount::try_from(pose));
            own.add("rear_axle_in_base_link", pose, source);
        }
        if let Some((mount, source)) = own.derived(&proposal.lidar) {
            own.take_mount(&mount, source);
        }
        own
    }

    /// Returns a derived value and its source, or notes the reason that there is none.
    fn derived<T: Clone>(
        &mut self,
        of: &Result<fleetcal_description::Derived<T>, Underivable>,
    ) -> Option<(T, String)> {
        match of {
            Ok(derived) => Some((derived.value.clone(), derived.source.clone())),
            Err(refused) => {
                self.lacks(&refused.to_string());
                None
            }
        }
    }

    fn accepted<T, E: std::fmt::Display>(&mut self, of: Result<T, E>) -> Option<T> {
        of.map_err(|refused| self.lacks(&refused.to_string())).ok()
    }

    /// Notes why a value is missing: `key: got …, expected …`.
    fn lacks(&mut self, sentence: &str) {
        let (key, reason) = sentence.split_once(": ").unwrap_or(("", sentence));
        let known = self.missing.iter_mut().find(|of| of.reason == reason);
        match known {
            Some(known) => known.keys.push(key.to_owned()),
            None => self.missing.push(Missing {
                keys: vec![key.to_owned()],
                reason: reason.to_owned(),
            }),
        }
    }

    fn add(&mut self, key: &str, value: impl Serialize, source: String) {
        self.values.push(DescribedValue {
            key: key.to_owned(),
            value: json!(value),
            source,
            used: false,
            in_use: None,
            contradicted: false,
        });
    }

    fn take_joints(&mut self, proposal: &Proposal) {
        let radius = self.derived(&proposal.wheel_radius_m);
        let Some((joints, source)) = self.derived(&proposal.joints) else {
            return;
        };
        let (wheel_radius_m, radius_source) = radius.unzip();
        let wheel_radius_m = wheel_radius_m.map(in_digits);
        let taken = Joints {
            steering: joints.steering.first().cloned(),
            steering_right: joints.steering.get(1).cloned(),
            steering_gear: joints.steering_gear,
            wheels: match wheel_radius_m {
                Some(_) => joints.wheels,
                None => Vec::new(),
            },
            wheel_radius_m,
            wheel_gear: joints.wheel_gear,
        };
        let source = match radius_source {
            Some(of) => format!("{source}; radius: {of}"),
            None => source,
        };
        self.add("streams.joints", &taken, source);
        let fields = StreamsFields {
            joints: Some(taken.clone()),
            ..StreamsFields::default()
        };
        let checked = RobotStreams::try_from(fields);
        self.joints = self.accepted(checked).map(|_| taken);
    }

    fn take_mount(&mut self, mount: &LidarMount, source: String) {
        let frame = &mount.frame;
        if mount.upside_down {
            self.lacks(&format!(
                "nominal_extrinsics: got {frame} upside down, expected an upright frame of the scans"
            ));
            return;
        }
        let Some(pose) = mount.in_base else {
            self.lacks(&format!(
                "nominal_extrinsics: got {frame} in base_link alone, expected the rear axle there too"
            ));
            return;
        };
        let pose = pose_in_digits(pose);
        self.nominal_extrinsics = self.accepted(Mount::try_from(pose));
        self.add("nominal_extrinsics", pose, source);
    }

    /// Returns the place of the speed measurement, that of the model where there is no other.
    fn speed_place(&self) -> Option<SpeedMeasuredAt> {
        let usual = self.model.map(VehicleModel::speed_measured_at);
        self.speed_measured_at.or(usual)
    }

    /// Fills the parts of a configuration that nothing else gives. The place of the speed measurement
    /// is not one of them: where it is unset, it is that of the configuration's model.
    pub fn fill(&self, config: &mut RobotConfig) {
        config.nominal_extrinsics = config.nominal_extrinsics.or(self.nominal_extrinsics);
        config.rear_axle_in_base_link = config
            .rear_axle_in_base_link
            .or(self.rear_axle_in_base_link);
        if config.streams.joints().is_none()
            && let Some(joints) = &self.joints
        {
            set_joints(config, joints);
        }
    }

    /// Makes the configuration of a robot of which nothing else is known; `None` if model or
    /// wheelbase cannot be derived.
    pub fn config(&self) -> Option<RobotConfig> {
        let mut config = RobotConfig::of_vehicle(self.model?, self.wheelbase_m?);
        config.speed_measured_at = self.speed_measured_at;
        self.fill(&mut config);
        Some(config)
    }

    /// Makes the configuration of a robot after the described values have replaced those that they
    /// contradict or that it lacks; `None` if it has no configuration and model or wheelbase cannot be
    /// derived.
    pub fn over(&self, config: Option<RobotConfig>) -> Option<RobotConfig> {
        let Some(mut config) = config else {
            return self.config();
        };
        let before = config.clone();
        let is_apart = |key| matches!(self.comparison(key, &before), Comparison::Apart);
        if is_apart("nominal_extrinsics") {
            config.nominal_extrinsics = None;
        }
        if is_apart("rear_axle_in_base_link") {
            config.rear_axle_in_base_link = None;
        }
        if is_apart("streams.joints")
            && let Some(joints) = &self.joints
        {
            set_joints(&mut config, joints);
        }
        if is_apart("wheelbase_m") {
            config.wheelbase_m = self.wheelbase_m.unwrap_or(config.wheelbase_m);
        }
        if let Some(model) = self.model {
            config.model = model;
            config.speed_measured_at = if is_apart("speed_measured_at") {
                self.speed_measured_at
            } else {
                // The place in use stays, though the model's own may have been another one.
                let in_use = before.vehicle().speed_measured_at;
                let is_usual = in_use == model.speed_measured_at();
                Some(in_use).filter(|_| !is_usual)
            };
        }
        self.fill(&mut config);
        Some(config)
    }

    /// Returns the reason for which a value is missing: `got …, expected …`.
    pub fn reason(&self, key: &str) -> Option<&str> {
        let has = |of: &&Missing| of.keys.iter().any(|own| own == key);
        self.missing.iter().find(has).map(|of| of.reason.as_str())
    }

    /// Makes the document. `in_use` is the robot's configuration: what it has from the description
    /// is marked, and where it contradicts the description a remark says so.
    pub fn document(
        &self,
        origins: Vec<String>,
        in_use: Option<&RobotConfig>,
    ) -> DescriptionDocument {
        let mut values = self.values.clone();
        let mut remarks = self.remarks.clone();
        if let Some(config) = in_use {
            for value in &mut values {
                value.in_use = configured(&value.key, config);
                match (self.comparison(&value.key, config), &value.in_use) {
                    (Comparison::Same, _) => value.used = true,
                    (Comparison::Apart, Some(used)) => {
                        value.contradicted = true;
                        remarks.push(format!(
                            "{}: {used} is used, and the description has {} ({})",
                            value.key, value.value, value.source
                        ));
                    }
                    _ => {}
                }
            }
        }
        DescriptionDocument {
            origins,
            values,
            missing: self
                .missing
                .iter()
                .map(|of| format!("{}: {}", of.keys.join(", "), of.reason))
                .collect(),
            remarks,
        }
    }

    fn comparison(&self, key: &str, config: &RobotConfig) -> Comparison {
        match key {
            "model" => Comparison::of(Some(&config.model), self.model.as_ref(), |_, _| false),
            "speed_measured_at" => {
                let own = config.vehicle().speed_measured_at;
                Comparison::of(Some(&own), self.speed_place().as_ref(), places_agree)
            }
            "wheelbase_m" => {
                let near = |one: &Wheelbase, other: &Wheelbase| {
                    lengths_agree(one.metres(), other.metres())
                };
                Comparison::of(Some(&config.wheelbase_m), self.wheelbase_m.as_ref(), near)
            }
            "streams.joints" => {
                Comparison::of(config.streams.joints(), self.joints.as_ref(), joints_agree)
            }
            "nominal_extrinsics" => {
                let (own, described) = (&config.nominal_extrinsics, &self.nominal_extrinsics);
                Comparison::of(own.as_ref(), described.as_ref(), mounts_agree)
            }
            "rear_axle_in_base_link" => {
                let (own, described) =
                    (&config.rear_axle_in_base_link, &self.rear_axle_in_base_link);
                Comparison::of(own.as_ref(), described.as_ref(), mounts_agree)
            }
            _ => Comparison::Unset,
        }
    }
}

/// Sets the joints of a configuration. They were checked by themselves; a stream of the configuration
/// that needs more of them keeps its own.
fn set_joints(config: &mut RobotConfig, joints: &Joints) {
    let fields = StreamsFields {
        joints: Some(joints.clone()),
        ..config.streams.fields().clone()
    };
    if let Ok(streams) = RobotStreams::try_from(fields) {
        config.streams = streams;
    }
}

/// Returns the value of a configuration that a described one is compared with.
fn configured(key: &str, config: &RobotConfig) -> Option<Value> {
    match key {
        "model" => Some(json!(config.model)),
        "speed_measured_at" => Some(json!(config.vehicle().speed_measured_at)),
        "wheelbase_m" => Some(json!(config.wheelbase_m)),
        "streams.joints" => config.streams.joints().map(|joints| json!(joints)),
        "nominal_extrinsics" => config.nominal_extrinsics.map(|mount| json!(mount)),
        "rear_axle_in_base_link" => config.rear_axle_in_base_link.map(|mount| json!(mount)),
        _ => None,
    }
}

/// Relation of a value in use to the described one.
enum Comparison {
    Same,
    Close,
    Apart,
    Unset,
}

impl Comparison {
    fn of<T: PartialEq>(
        used: Option<&T>,
        described: Option<&T>,
        agree: impl Fn(&T, &T) -> bool,
    ) -> Self {
        match (used, described) {
            (Some(used), Some(described)) if used == described => Self::Same,
            (Some(used), Some(described)) if agree(used, described) => Self::Close,
            (Some(_), Some(_)) => Self::Apart,
            _ => Self::Unset,
        }
    }
}

/// True if both places are on the steered wheel, or both on the fixed axle.
fn places_agree(one: &SpeedMeasuredAt, other: &SpeedMeasuredAt) -> bool {
    let is_steered = |place: &SpeedMeasuredAt| *place == SpeedMeasuredAt::SteeredWheel;
    is_steered(one) == is_steered(other)
}

fn lengths_agree(one: f64, other: f64) -> bool {
    (one - other).abs() <= LENGTHS_APART * one.abs().max(other.abs())
}

fn mounts_agree(one: &Mount, other: &Mount) -> bool {
    let between: Pose2 = one.pose().between(&other.pose());
    between.x_m.hypot(between.y_m) <= POSES_APART_M
        && fleetcal_model::wrap_angle_rad(between.yaw_rad).abs() <= POSES_APART_RAD
}

/// True if joints that both name are the same, with gears of one sign and a radius that agrees: a
/// configuration may know a gear that no description has.
fn joints_agree(used: &Joints, described: &Joints) -> bool {
    let radii = used.wheel_radius_m.zip(described.wheel_radius_m);
    (&used.steering, &used.steering_right) == (&described.steering, &described.steering_right)
        && (used.wheels.is_empty() || used.wheels == described.wheels)
        && used.steering_gear.signum() == described.steering_gear.signum()
        && radii.is_none_or(|(one, other)| lengths_agree(one, other))
}

/// Rounds to nine decimals: sums of a drawing's lengths have bits beyond its digits.
fn in_digits(exact: f64) -> f64 {
    // Adding zero takes the sign of a negative one away.
    (exact * 1e9).round() / 1e9 + 0.0
}

/// Rounds the parts of a pose.
fn pose_in_digits(exact: Pose2) -> Pose2 {
    let Pose2 { x_m, y_m, yaw_rad } = exact;
    let [x_m, y_m, yaw_rad] = [x_m, y_m, yaw_rad].map(in_digits);
    Pose2 { x_m, y_m, yaw_rad }
}

#[cfg(test)]
mod tests {
    use fleetcal_description::Description;

    use super::*;

    const TUGGER: &str = include_str!("../../../../proto/description/tests/urdf/tugger.urdf");
    const TRICYCLE: &str = include_str!("../../../../proto/description/tests/urdf/tricycle.urdf");
    const ACKERMANN: &str = include_str!("../../../../proto/description/tests/urdf/ackermann.urdf");

    fn described(urdf: &str, frame: Option<&str>) -> DescribedConfig {
        let mut description = Description::default();
        description.set_urdf(urdf).unwrap();
        DescribedConfig::of(&description.propose(frame))
    }

    #[test]
    fn a_sum_of_lengths_has_the_digits_of_the_drawing() {
        let own = described(TUGGER, None);
        let metres = own.wheelbase_m.unwrap().metres();
        assert_eq!(json!(metres), json!(1.2));
        let mount = own.nominal_extrinsics.unwrap();
        assert_eq!(json!(mount)["x_m"], json!(0.434));
    }

    #[test]
    fn a_description_makes_a_whole_configuration_and_says_what_it_gave() {
        let by_itself = described(TUGGER, Some("lidar"));
        let config = by_itself.config().unwrap();
        assert_eq!(config.model, VehicleModel::Bicycle);
        assert!((config.wheelbase_m.metres() - 1.2).abs() < 1e-9);
        let joints = config.streams.joints().unwrap();
        assert_eq!(joints.steering.as_deref(), Some("steer_joint"));
        assert_eq!(
            joints.wheels,
            ["rear_left_wheel_joint", "rear_right_wheel_joint"]
        );
        assert!((config.nominal_extrinsics.unwrap().pose().x_m - 0.434).abs() < 1e-9);
        assert!((config.rear_axle_in_base_link.unwrap().pose().x_m + 0.4).abs() < 1e-9);

        let document = by_itself.document(vec!["a.urdf".to_owned()], Some(&config));
        let used = document.values.iter().filter(|value| value.used);
        let used: Vec<&str> = used.map(|value| value.key.as_str()).collect();
        assert_eq!(
            used,
            [
                "model",
                "speed_measured_at",
                "wheelbase_m",
                "streams.joints",
                "rear_axle_in_base_link",
                "nominal_extrinsics"
            ]
        );
        assert_eq!(document.missing, Vec::<String>::new());
        assert_eq!(document.remarks.len(), 1, "{:?}", document.remarks);
    }

    #[test]
    fn given_values_win_and_what_contradicts_them_is_a_remark() {
        let by_itself = described(TUGGER, Some("lidar"));
        let wheelbase = Wheelbase::try_from(1.55).unwrap();
        let mut config = RobotConfig::of_vehicle(VehicleModel::Tricycle, wheelbase);
        let mount = Mount::try_from(Pose2::new(0.44, 0.0, 3.1)).unwrap();
        config.nominal_extrinsics = Some(mount);
        by_itself.fill(&mut config);
        assert_eq!(config.nominal_extrinsics, Some(mount));
        assert!(config.streams.joints().is_some());
        let document = by_itself.document(Vec::new(), Some(&config));
        let about: Vec<&str> = document.remarks.iter().map(String::as_str).collect();
        for wanted in [
            "model: \"tricycle\" is used, and the description has \"bicycle\" (URDF: steered",
            "wheelbase_m: 1.55 is used, and the description has 1.2",
            "nominal_extrinsics: {",
        ] {
            assert!(
                about.iter().any(|of| of.starts_with(wanted)),
                "{wanted}: {about:?}"
            );
        }
        // Within a hundredth nobody is wrong, and the given value stays.
        config.wheelbase_m = Wheelbase::try_from(1.205).unwrap();
        let document = by_itself.document(Vec::new(), Some(&config));
        assert!(
            !document
                .remarks
                .iter()
                .any(|of| of.starts_with("wheelbase_m"))
        );
    }

    #[test]
    fn a_driven_wheel_behind_the_fixed_ones_is_rear_steered_with_its_own_speed() {
        let urdf = TRICYCLE.replace("xyz=\"0.7 0 -0.3\"", "xyz=\"-2.3 0 -0.3\"");
        let by_itself = described(&urdf, None);
        let config = by_itself.config().unwrap();
        assert_eq!(config.model, VehicleModel::RearSteered);
        let at_wheel = Some(SpeedMeasuredAt::SteeredWheel);
        assert_eq!(config.speed_measured_at, at_wheel);
        assert!(config.streams.joints().unwrap().steering_gear > 0.0);
        // A configuration of the former proposal, and one that contradicts it.
        let mut former = config.clone();
        former.model = VehicleModel::Tricycle;
        former.speed_measured_at = Some(SpeedMeasuredAt::RearAxle);
        let document = by_itself.document(Vec::new(), Some(&former));
        let contradicted = document.values.iter().filter(|value| value.contradicted);
        let keys: Vec<&str> = contradicted.map(|value| value.key.as_str()).collect();
        assert_eq!(keys, ["model", "speed_measured_at"]);
        assert_eq!(by_itself.over(Some(former)), Some(config.clone()));
        // One whose model has that place as its own.
        let tricycle = RobotConfig::of_vehicle(VehicleModel::Tricycle, config.wheelbase_m);
        let over = by_itself.over(Some(tricycle)).unwrap();
        assert_eq!(over.vehicle(), config.vehicle());
    }

    #[test]
    fn the_place_of_the_speed_is_taken_with_the_model_alone() {
        let rear = TRICYCLE.replace("xyz=\"0.7 0 -0.3\"", "xyz=\"-2.3 0 -0.3\"");
        let contradicted = |by_itself: &DescribedConfig, config: &RobotConfig| {
            let document = by_itself.document(Vec::new(), Some(config));
            let place = document.values.iter();
            let mut place = place.filter(|value| value.key == "speed_measured_at");
            place.any(|value| value.contradicted)
        };
        let by_itself = described(&rear, None);
        let wheelbase = by_itself.wheelbase_m.unwrap();
        let own = RobotConfig::of_vehicle(VehicleModel::RearSteered, wheelbase);
        let mut filled = own.clone();
        by_itself.fill(&mut filled);
        assert_eq!(filled.vehicle(), own.vehicle());
        assert!(contradicted(&by_itself, &filled));

        // A place that the description does not have is cleared.
        let by_itself = described(TUGGER, None);
        let mut own = RobotConfig::of_vehicle(VehicleModel::Bicycle, wheelbase);
        own.speed_measured_at = Some(SpeedMeasuredAt::SteeredWheel);
        assert!(contradicted(&by_itself, &own));
        let over = by_itself.over(Some(own.clone())).unwrap();
        assert_eq!(over.speed_measured_at, None);
        // One wheel of the fixed axle is a nearer place on it.
        let at_wheel = SpeedMeasuredAt::RearWheel { lateral_m: 0.3 };
        own.speed_measured_at = Some(at_wheel);
        assert!(!contradicted(&by_itself, &own));
        let over = by_itself.over(Some(own)).unwrap();
        assert_eq!(over.speed_measured_at, Some(at_wheel));
    }

    #[test]
    fn what_cannot_be_taken_over_has_its_reason() {
        let tricycle = described(TRICYCLE, None);
        assert_eq!(tricycle.nominal_extrinsics, None);
        let reason = tricycle.reason("nominal_extrinsics").unwrap();
        assert!(reason.starts_with("got lidar_link upside down"), "{reason}");
        assert_eq!(tricycle.config().unwrap().model, VehicleModel::Tricycle);

        let ackermann = described(ACKERMANN, None);
        assert_eq!(ackermann.reason("streams.joints"), None);
        let joints = ackermann.joints.unwrap();
        let both = [&joints.steering, &joints.steering_right].map(Option::as_deref);
        let sides = ["left_wheel_steering_joint", "right_wheel_steering_joint"];
        assert_eq!(both, sides.map(Some));
        // One reason for several values is one sentence.
        let none = DescribedConfig::of(&Description::default().propose(None));
        let missing = none.document(Vec::new(), None).missing;
        assert!(
            missing[0].starts_with("model, wheelbase_m, track_m, wheel_radius_m, streams.joints"),
            "{missing:?}"
        );
        assert_eq!(none.config(), None);
    }
}
