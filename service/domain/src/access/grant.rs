//! Grant of a user or token: a role, and for the role of a robot the one robot.

use fleetcal_proto::RobotId;
use thiserror::Error;

use super::Role;

/// Reason for which a role was not granted.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum GrantRefused {
    /// Role of a robot without a robot.
    #[error("a token of role robot is bound to one robot: name it")]
    RobotMissing,
    /// Robot with another role than a robot's.
    #[error("only a token of role robot is bound to a robot, not one of role {}", .0.as_str())]
    RobotNotAccepted(Role),
    /// Role of a robot for a person.
    #[error("role: got \"robot\", expected viewer, operator, approver or admin for a person")]
    NoPerson,
}

/// A role, bound to one robot exactly when it is the role of a robot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Grant {
    role: Role,
    robot: Option<RobotId>,
}

impl Grant {
    /// Grant of a token.
    ///
    /// # Errors
    /// Returns an error when the role requires a robot that is missing, or excludes the given one.
    pub fn of_token(role: Role, robot: Option<RobotId>) -> Result<Self, GrantRefused> {
        match (role, &robot) {
            (Role::Robot, None) => Err(GrantRefused::RobotMissing),
            (Role::Robot, Some(_)) | (_, None) => Ok(Self { role, robot }),
            (_, Some(_)) => Err(GrantRefused::RobotNotAccepted(role)),
        }
    }

    /// Grant of a person.
    ///
    /// # Errors
    /// Returns an error when the role is a robot's.
    pub fn of_person(role: Role) -> Result<Self, GrantRefused> {
        match role {
            Role::Robot => Err(GrantRefused::NoPerson),
            _ => Ok(Self { role, robot: None }),
        }
    }

    /// The role.
    pub const fn role(&self) -> Role {
        self.role
    }

    /// The robot that the grant is bound to.
    pub const fn robot(&self) -> Option<&RobotId> {
        self.robot.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_robot_goes_with_its_role_alone() {
        let robot = RobotId::parse("agv_1").unwrap();
        for &role in Role::ALL {
            let is_robot = role == Role::Robot;
            assert_eq!(Grant::of_token(role, None).is_ok(), !is_robot);
            assert_eq!(Grant::of_token(role, Some(robot.clone())).is_ok(), is_robot);
            assert_eq!(Grant::of_person(role).is_ok(), !is_robot);
        }
        let bound = Grant::of_token(Role::Robot, Some(robot.clone())).unwrap();
        assert_eq!((bound.role(), bound.robot()), (Role::Robot, Some(&robot)));
    }
}
