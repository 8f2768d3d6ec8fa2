//! Text that is compared in lower case: in queries, and of the robots that they select.

use fleetcal_domain::robot::ConnectionState;
use fleetcal_model::{Label, VehicleModel};

use crate::properties::Properties;
use crate::word::Word;

/// Text as it was written, and in lower case.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Folded {
    written: String,
    folded: String,
}

impl Folded {
    /// Text as it was written.
    pub fn as_str(&self) -> &str {
        &self.written
    }

    /// Text in lower case.
    pub(crate) fn folded(&self) -> &str {
        &self.folded
    }
}

impl From<String> for Folded {
    fn from(written: String) -> Self {
        let folded = written.to_lowercase();
        Self { written, folded }
    }
}

/// Texts of one robot in lower case, made once for all conditions of a query.
pub(crate) struct FoldedProperties<'r> {
    robot: &'r Properties<'r>,
    /// Id of the robot.
    pub(crate) id: String,
    site: Option<String>,
    vehicle_type: Option<String>,
    tags: Vec<String>,
}

impl<'r> FoldedProperties<'r> {
    /// Texts of a robot.
    pub(crate) fn of(robot: &'r Properties<'r>) -> Self {
        Self {
            robot,
            id: robot.id.to_lowercase(),
            site: robot.site.map(Label::folded),
            vehicle_type: robot.vehicle_type.map(Label::folded),
            tags: robot.tags.iter().map(Label::folded).collect(),
        }
    }

    /// True if a property is this value, in upper or lower case.
    pub(crate) fn has(&self, word: Word, value: &Folded) -> bool {
        let wanted = value.folded();
        match word {
            Word::Id => self.id == wanted,
            Word::Site => self.site.as_deref() == Some(wanted),
            Word::Type => self.vehicle_type.as_deref() == Some(wanted),
            Word::Tag => self.tags.iter().any(|tag| tag == wanted),
            Word::Model => self.robot.model.map(VehicleModel::name) == Some(wanted),
            Word::State => self.robot.state.name() == wanted,
            Word::Standing => self.robot.standing.as_str() == wanted,
            Word::Connection => {
                let mut all = ConnectionState::ALL.iter();
                all.any(|state| state.name() == wanted && self.robot.is_connected(*state))
            }
        }
    }
}
