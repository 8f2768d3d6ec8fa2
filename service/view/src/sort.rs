//! Orders of lists of robots, and positions in them.

use std::fmt;
use std::str::FromStr;

use fleetcal_domain::robot::ConnectionState;
use fleetcal_domain::standing::Standing;
use fleetcal_model::Label;
use strum::{EnumString, IntoStaticStr, VariantArray};
use thiserror::Error;

use crate::properties::Properties;

/// Property that a list is sorted by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "snake_case")]
pub enum SortKey {
    /// Id of the robot.
    #[default]
    Id,
    /// Standing, the most urgent first; silent robots come before those that need nobody.
    Severity,
    /// Deviation in tolerances.
    Deviation,
    /// Time since the last message.
    Age,
    /// Site of the robot.
    Site,
    /// Type of the vehicle by its maker.
    Type,
    /// Steering of the vehicle.
    Model,
}

/// Order of a list: by a property, then by id. Robots without the property come last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Sort {
    /// The property.
    pub key: SortKey,
    /// True if the largest value comes first.
    pub is_descending: bool,
}

/// Reason for which an order was refused: its text is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("not an order")]
pub struct SortRefused;

/// Reason for which a position was refused: its text is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("not a position in a list")]
pub struct PositionRefused;

/// Position of a robot in a sorted list. Positions compare as the list is sorted.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Position {
    /// Bytes that compare as the property does.
    key: Vec<u8>,
    id: String,
}

impl Sort {
    /// Accepted texts, in words.
    pub fn accepted() -> String {
        let names = SortKey::VARIANTS.iter().map(|key| <&str>::from(*key));
        let names: Vec<&str> = names.collect();
        format!(
            "one of {}, with - before it for the opposite",
            names.join(", ")
        )
    }

    /// Position of a robot.
    pub fn position(self, robot: &Properties) -> Position {
        let label = |label: Option<&Label>| label.map(|label| bytes_of(&label.folded()));
        let number = |number: Option<f64>| number.map(|one| one.to_bits().to_be_bytes().to_vec());
        let value = match self.key {
            SortKey::Id => Some(bytes_of(robot.id)),
            SortKey::Severity => Some(vec![urgency(robot) as u8]),
            SortKey::Deviation => number(robot.deviation),
            SortKey::Age => number(robot.age_s),
            SortKey::Site => label(robot.site),
            SortKey::Type => label(robot.vehicle_type),
            SortKey::Model => robot.model.map(|model| bytes_of(model.name())),
        };
        let key = match value {
            None => vec![1],
            Some(value) => {
                let turned = |byte: u8| if self.is_descending { !byte } else { byte };
                let value = value.into_iter().map(turned);
                std::iter::once(0).chain(value).collect()
            }
        };
        Position {
            key,
            id: robot.id.to_owned(),
        }
    }
}

/// Standing by which a robot is sorted: a silent robot comes before those that need nobody.
fn urgency(robot: &Properties) -> Standing {
    if robot.is_connected(ConnectionState::Silent) {
        robot.standing.min(Standing::NoData)
    } else {
        robot.standing
    }
}

/// Bytes of a text, with an end that is less than any character of a label or an id: also turned
/// round they compare as the texts do.
fn bytes_of(text: &str) -> Vec<u8> {
    text.bytes().chain([0]).collect()
}

impl FromStr for Sort {
    type Err = SortRefused;

    fn from_str(text: &str) -> Result<Self, SortRefused> {
        let (is_descending, name) = match text.strip_prefix('-') {
            Some(name) => (true, name),
            None => (false, text),
        };
        let key = name.parse().map_err(|_| SortRefused)?;
        Ok(Self { key, is_descending })
    }
}

impl fmt::Display for Sort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = if self.is_descending { "-" } else { "" };
        write!(f, "{sign}{}", <&str>::from(self.key))
    }
}

impl FromStr for Position {
    type Err = PositionRefused;

    fn from_str(text: &str) -> Result<Self, PositionRefused> {
        let (key, id) = text.split_once('.').ok_or(PositionRefused)?;
        Ok(Self {
            key: hex::decode(key).map_err(|_| PositionRefused)?,
            id: id.to_owned(),
        })
    }
}

impl fmt::Display for Position {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", hex::encode(&self.key), self.id)
    }
}

#[cfg(test)]
mod tests;
