//! Cell of the campaign: one imperfection, one route, one scenario.

use std::fmt;
use std::str::FromStr;

use fleetcal_robot::simulator::{ImperfectionKind, Imperfections, Point, Route, Strength};
use serde::{Deserialize, Serialize};

/// Imperfection of a robot in the campaign.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Flaw {
    /// No imperfection.
    Clean,
    /// One imperfection.
    One(ImperfectionKind, Strength),
    /// Every one at its typical size, signs and sizes drawn.
    AllTypical,
}

impl Flaw {
    /// Returns no imperfection, each single one at both strengths, and all at once.
    pub fn all() -> Vec<Self> {
        let sized = |kind: &ImperfectionKind, strength: &Strength| {
            kind.has_size() || *strength == Strength::Typical
        };
        let single = ImperfectionKind::ALL.into_iter().flat_map(move |kind| {
            let strengths = Strength::ALL.into_iter();
            strengths
                .filter(move |strength| sized(&kind, strength))
                .map(move |strength| Self::One(kind, strength))
        });
        std::iter::once(Self::Clean)
            .chain(single)
            .chain([Self::AllTypical])
            .collect()
    }

    /// Returns the name for `--only`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Clean => "none",
            Self::One(kind, _) => kind.name(),
            Self::AllTypical => "all",
        }
    }

    /// Returns `typical` or `strong`; `-` for a clean robot.
    pub const fn strength(self) -> &'static str {
        match self {
            Self::Clean => "-",
            Self::One(_, strength) => strength.name(),
            Self::AllTypical => "typical",
        }
    }

    /// True if a robot has to send scans to show it.
    pub const fn needs_scans(self) -> bool {
        match self {
            Self::One(kind, _) => kind.needs_scans(),
            Self::Clean | Self::AllTypical => false,
        }
    }

    /// Returns the imperfections of the robot of a seed.
    pub fn imperfections(self, seed: u64, sensor: Sensor) -> Imperfections {
        match self {
            Self::Clean => Imperfections::default(),
            Self::One(kind, strength) => Imperfections::drawn(kind, strength, seed),
            Self::AllTypical => Imperfections::all_typical(seed, sensor == Sensor::Scans),
        }
    }
}

/// Route of a robot in the campaign.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Road {
    /// Figure-eight: both turns.
    Eight,
    /// Warehouse aisles, five left turns and a right one, two stretches of each lap backwards.
    Aisles,
    /// A loop of left turns.
    Left,
}

impl Road {
    /// All routes.
    pub const ALL: [Self; 3] = [Self::Eight, Self::Aisles, Self::Left];

    /// Routes with turns to both sides.
    pub const TWO_SIDED: [Self; 2] = [Self::Eight, Self::Aisles];

    /// Returns its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Eight => "eight",
            Self::Aisles => "aisles",
            Self::Left => "left",
        }
    }

    /// Returns the route.
    pub fn route(self) -> Route {
        match self {
            Self::Eight => Route::staging_figure_eight(),
            Self::Aisles => Route::aisles_with_reversals(),
            Self::Left => Route::left_loop(Point::new(-11.0, 0.0), 10.0, 8.0),
        }
    }
}

/// LiDAR stream of a robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sensor {
    /// Poses of its own odometry: 3 mm and 0.03°, white.
    Poses,
    /// Raw scans, for the estimator's LiDAR odometry.
    Scans,
}

impl Sensor {
    /// Returns its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Poses => "poses",
            Self::Scans => "scans",
        }
    }
}

/// Injected change of the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum InjectedChange {
    /// The steering zero jumps by 0.5°.
    Steering,
    /// The LiDAR turns by 0.5°.
    MountYaw,
    /// The LiDAR moves by 20 mm in any direction.
    MountMoved,
    /// The LiDAR moves by 10 mm to one side.
    MountSideways,
}

impl InjectedChange {
    /// All changes.
    pub const ALL: [Self; 4] = [
        Self::Steering,
        Self::MountYaw,
        Self::MountMoved,
        Self::MountSideways,
    ];

    /// Returns its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Steering => "steering_0.5deg",
            Self::MountYaw => "mount_yaw_0.5deg",
            Self::MountMoved => "mount_20mm",
            Self::MountSideways => "mount_y_10mm",
        }
    }
}

/// Speed before and after a change.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Speed {
    /// Speed of 0.3 m/s.
    Slow,
    /// Speed of 1 m/s.
    Fast,
}

impl Speed {
    /// Both speeds.
    pub const ALL: [Self; 2] = [Self::Slow, Self::Fast];

    /// Returns the speed, m/s.
    pub const fn mps(self) -> f64 {
        match self {
            Self::Slow => 0.3,
            Self::Fast => 1.0,
        }
    }
}

/// Place of a cell's figures among the results: cells of one place are pooled.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// Caption of the table.
    pub table: String,
    /// Row of the table.
    pub row: String,
}

/// Scenario of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scenario {
    /// An unchanged robot that starts cold: its claims, its errors and false changes.
    Unchanged,
    /// A robot on which something changes once it has driven a while: the alarm.
    Changed(InjectedChange, Speed),
}

impl Scenario {
    /// Returns all scenarios.
    pub fn all() -> Vec<Self> {
        let changed = InjectedChange::ALL
            .into_iter()
            .flat_map(|change| Speed::ALL.map(|speed| Self::Changed(change, speed)));
        std::iter::once(Self::Unchanged).chain(changed).collect()
    }
}

impl fmt::Display for Scenario {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Unchanged => write!(out, "unchanged"),
            Self::Changed(change, speed) => write!(out, "{}@{}m/s", change.name(), speed.mps()),
        }
    }
}

/// Common properties of the runs of one row of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Cell {
    /// Imperfection of the robot.
    pub flaw: Flaw,
    /// Its route.
    pub road: Road,
    /// Its LiDAR stream.
    pub sensor: Sensor,
    /// Its scenario.
    pub scenario: Scenario,
}

impl Cell {
    /// Returns the place of its figures: unchanged robots by imperfection, changes by change, route
    /// and speed.
    pub fn place(&self) -> Place {
        let sensor = self.sensor.name();
        match self.scenario {
            Scenario::Unchanged => Place {
                table: format!("Unchanged robots, by {sensor}"),
                row: match self.flaw {
                    Flaw::One(kind, Strength::Strong) => format!("{}, strong", kind.name()),
                    flaw => flaw.name().to_owned(),
                },
            },
            Scenario::Changed(change, speed) => Place {
                table: format!("Changes, by {sensor}"),
                row: format!(
                    "{}, {}, {} m/s",
                    change.name(),
                    self.road.name(),
                    speed.mps()
                ),
            },
        }
    }
}

impl fmt::Display for Cell {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        let Self {
            flaw,
            road,
            sensor,
            scenario,
        } = self;
        write!(
            out,
            "{} {} {} {} {scenario}",
            flaw.name(),
            flaw.strength(),
            road.name(),
            sensor.name()
        )
    }
}

/// Error of an unknown name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("got {got:?}, expected one of {expected}")]
pub struct UnknownName {
    got: String,
    expected: String,
}

fn by_name<T: Copy>(
    got: &str,
    all: &[T],
    name: impl Fn(T) -> &'static str,
) -> Result<T, UnknownName> {
    let found = all.iter().copied().find(|one| name(*one) == got);
    found.ok_or_else(|| UnknownName {
        got: got.to_owned(),
        expected: all
            .iter()
            .map(|one| name(*one))
            .collect::<Vec<_>>()
            .join(", "),
    })
}

impl FromStr for Road {
    type Err = UnknownName;

    fn from_str(text: &str) -> Result<Self, UnknownName> {
        by_name(text, &Self::ALL, Self::name)
    }
}

impl FromStr for Sensor {
    type Err = UnknownName;

    fn from_str(text: &str) -> Result<Self, UnknownName> {
        by_name(text, &[Self::Poses, Self::Scans], Self::name)
    }
}

impl FromStr for InjectedChange {
    type Err = UnknownName;

    fn from_str(text: &str) -> Result<Self, UnknownName> {
        by_name(text, &Self::ALL, Self::name)
    }
}
