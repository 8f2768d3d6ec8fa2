//! Permission that a route requires.

use super::{Grant, Role};

/// Permission required of a route's caller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// Callers without credentials too.
    Public,
    /// Viewers and higher roles.
    Viewer,
    /// Operators and higher roles.
    Operator,
    /// Approvers and administrators.
    Approver,
    /// Administrators.
    Admin,
    /// The robot that the path names alone.
    OwnRobot,
    /// The robot that the path names, viewers and higher roles.
    OwnRobotOrViewer,
}

impl Access {
    /// True if a caller with `grant` may call a route whose path names `robot`. A public route
    /// needs no grant.
    pub fn permits(self, grant: &Grant, robot: Option<&str>) -> bool {
        let own = || {
            let bound = grant.robot().map(fleetcal_proto::RobotId::as_str);
            bound.is_some() && bound == robot
        };
        let at_least = |role: Role| grant.role() != Role::Robot && grant.role() >= role;
        match self {
            Self::Public => true,
            Self::Viewer => at_least(Role::Viewer),
            Self::Operator => at_least(Role::Operator),
            Self::Approver => at_least(Role::Approver),
            Self::Admin => at_least(Role::Admin),
            Self::OwnRobot => own(),
            Self::OwnRobotOrViewer => own() || at_least(Role::Viewer),
        }
    }

    /// Permitted callers, in words.
    pub const fn accepted(self) -> &'static str {
        match self {
            Self::Public => "everybody",
            Self::Viewer => "a viewer at least",
            Self::Operator => "an operator at least",
            Self::Approver => "an approver at least",
            Self::Admin => "an administrator",
            Self::OwnRobot => "the robot itself",
            Self::OwnRobotOrViewer => "the robot itself or a viewer at least",
        }
    }
}

#[cfg(test)]
mod tests {
    use fleetcal_proto::RobotId;

    use super::*;

    const ALL: [Access; 7] = [
        Access::Public,
        Access::Viewer,
        Access::Operator,
        Access::Approver,
        Access::Admin,
        Access::OwnRobot,
        Access::OwnRobotOrViewer,
    ];

    /// Permissions of [`ALL`] that a grant satisfies, as ones and zeros.
    fn permitted(grant: &Grant, robot: Option<&str>) -> String {
        let digit = |access: &Access| {
            if access.permits(grant, robot) {
                '1'
            } else {
                '0'
            }
        };
        ALL.iter().map(digit).collect()
    }

    #[test]
    fn every_role_may_what_it_says() {
        let person = |role| permitted(&Grant::of_person(role).unwrap(), Some("a"));
        assert_eq!(person(Role::Viewer), "1100001");
        assert_eq!(person(Role::Operator), "1110001");
        assert_eq!(person(Role::Approver), "1111001");
        assert_eq!(person(Role::Admin), "1111101");
        let robot = Grant::of_token(Role::Robot, RobotId::parse("a").ok()).unwrap();
        assert_eq!(permitted(&robot, Some("a")), "1000011");
        assert_eq!(permitted(&robot, Some("b")), "1000000");
        assert_eq!(permitted(&robot, None), "1000000");
    }
}
