//! Reasons for which a description cannot be used.

use thiserror::Error;

/// Reason for which a description was refused.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum DescriptionRefused {
    /// The text is too long.
    #[error("robot_description: got {bytes} bytes, expected at most {limit}")]
    TooLarge {
        /// Its length.
        bytes: usize,
        /// Accepted length.
        limit: usize,
    },
    /// The text is not well-formed XML.
    #[error("robot_description: got no XML ({reason}), expected a URDF")]
    NoXml {
        /// The parser's reason.
        reason: String,
    },
    /// The outermost element is another one.
    #[error(
        "robot_description: got <{element}>, expected a URDF, whose outermost element is <robot>"
    )]
    NoRobot {
        /// Its name.
        element: String,
    },
    /// The text is a template.
    #[error(
        "robot_description: got the template <xacro:{element}>, expected an expanded URDF: `xacro \
         FILE > robot.urdf` writes one"
    )]
    Template {
        /// An element of xacro.
        element: String,
    },
    /// An attribute or element has an impossible value, or lacks one.
    #[error("{field}: got {found}, expected {expected}")]
    Field {
        /// The element and its attribute.
        field: String,
        /// Its value.
        found: String,
        /// Accepted values.
        expected: &'static str,
    },
    /// There are more entries than are kept.
    #[error("robot_description: got more than {limit} {what}, expected {limit} at most")]
    TooMany {
        /// The entries.
        what: &'static str,
        /// Number of accepted ones.
        limit: usize,
    },
}
