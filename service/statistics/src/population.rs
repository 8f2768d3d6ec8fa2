//! Robots of a kind, with what they share.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use fleetcal_domain::robot::RobotView;
use fleetcal_model::{Parameter, ParameterStatus, Unit};
use serde::{Deserialize, Serialize};

/// Values that statistics are made of.
pub const FOUR: [Parameter; 4] = [
    Parameter::SteeringOffset,
    Parameter::LidarX,
    Parameter::LidarY,
    Parameter::LidarYaw,
];

/// Property that robots are grouped by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum Grouping {
    /// Site of the robot.
    Site,
    /// Type of the vehicle by its maker; its model where no type is given.
    Type,
    /// Each tag of the robot.
    Tag,
}

/// Converged value of a robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Known {
    /// Value, in the unit of its parameter.
    pub value: f64,
    /// Standard deviation of the value.
    pub sigma: f64,
}

/// Robot with what statistics need of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Robot {
    /// Id of the robot.
    pub id: String,
    /// Type of the vehicle by its maker; its model where no type is given. Robots of one kind are
    /// compared with each other.
    pub kind: String,
    /// Site of the robot.
    pub site: Option<String>,
    /// Tags of the robot.
    pub tags: Vec<String>,
    /// Converged values, in the order of [`FOUR`].
    pub values: [Option<Known>; FOUR.len()],
}

impl Robot {
    /// Properties and converged values of a robot by its view. Robots without a configuration are of
    /// one kind, without a name.
    pub fn of(view: &RobotView) -> Self {
        let config = view.config.as_ref();
        let kind = config.map(|config| match &config.vehicle_type {
            Some(kind) => kind.to_string(),
            None => config.model.name().to_owned(),
        });
        let site = config.and_then(|config| config.site.as_ref());
        let tags = config.map_or(&[][..], |config| config.tags.as_slice());
        Self {
            id: view.id.to_string(),
            kind: kind.unwrap_or_default(),
            site: site.map(ToString::to_string),
            tags: tags.iter().map(ToString::to_string).collect(),
            values: FOUR.map(|name| {
                let parameter = view.estimate.as_deref()?.parameters.get(name);
                (parameter.status == ParameterStatus::Converged).then_some(Known {
                    value: parameter.value,
                    sigma: parameter.sigma,
                })
            }),
        }
    }

    /// Names of the groups that the robot is in.
    pub fn groups(&self, by: Grouping) -> Vec<&str> {
        match by {
            Grouping::Site => self.site.as_deref().into_iter().collect(),
            Grouping::Type => vec![&self.kind],
            Grouping::Tag => self.tags.iter().map(String::as_str).collect(),
        }
    }
}

/// Robots of one kind.
#[derive(Debug, Clone, Default)]
pub struct Population<'a> {
    /// The robots.
    pub robots: Vec<&'a Robot>,
}

impl<'a> Population<'a> {
    /// Divides robots by their kind.
    pub fn by_kind(robots: &'a [Robot]) -> BTreeMap<&'a str, Self> {
        let mut kinds: BTreeMap<&str, Self> = BTreeMap::new();
        for robot in robots {
            kinds.entry(&robot.kind).or_default().robots.push(robot);
        }
        kinds
    }

    /// Groups of at least `least` robots that not all belong to, by sites and tags.
    pub(crate) fn groups(&self, least: usize) -> Vec<(Grouping, &'a str)> {
        let mut sizes: BTreeMap<(Grouping, &str), usize> = BTreeMap::new();
        for robot in &self.robots {
            for by in [Grouping::Site, Grouping::Tag] {
                for name in robot.groups(by) {
                    *sizes.entry((by, name)).or_default() += 1;
                }
            }
        }
        let all = self.robots.len();
        sizes.retain(|_, size| (least..all).contains(size));
        sizes.into_keys().collect()
    }

    /// Robots in a group, and the others.
    pub(crate) fn divided(&self, (by, name): (Grouping, &str)) -> (Vec<&'a Robot>, Vec<&'a Robot>) {
        self.robots
            .iter()
            .partition(|robot| robot.groups(by).contains(&name))
    }
}

/// Known values of robots at one place of [`FOUR`]. Angles are those nearest to the first one: lidars
/// that face backwards have yaws beside both pi and -pi.
pub(crate) fn values(robots: &[&Robot], at: usize) -> Vec<f64> {
    let known = robots.iter().filter_map(|robot| robot.values[at]);
    let mut values: Vec<f64> = known.map(|known| known.value).collect();
    if let (Unit::Radian, Some(&first)) = (FOUR[at].unit(), values.first()) {
        for value in &mut values {
            *value = first + wrapped(*value - first);
        }
    }
    values
}

/// Angle between -pi and pi that points in the same direction.
pub(crate) fn wrapped(angle_rad: f64) -> f64 {
    angle_rad - TAU * (angle_rad / TAU).round()
}
