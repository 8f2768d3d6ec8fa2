//! Properties of a robot that are words.

use strum::{EnumString, IntoStaticStr, VariantArray};

/// Property that is a word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "snake_case")]
pub enum Word {
    /// Id of the robot.
    Id,
    /// Site of the robot.
    Site,
    /// Type of the vehicle by its maker.
    Type,
    /// One of the robot's tags.
    Tag,
    /// Steering of the vehicle.
    Model,
    /// State of the robot's estimate.
    State,
    /// Standing of the robot.
    Standing,
    /// Connection of the robot.
    Connection,
}

impl Word {
    /// The name in queries.
    pub fn name(self) -> &'static str {
        self.into()
    }
}
