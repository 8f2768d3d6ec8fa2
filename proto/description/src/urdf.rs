//! Vehicle-related part of a URDF: links with their round shapes, joints, and
//! the interfaces of `ros2_control`.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Isometry3, UnitVector3, Vector3};

use crate::DescriptionRefused;

/// Kind of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// It turns without limits.
    Continuous,
    /// It turns between limits.
    Revolute,
    /// Any other.
    Other,
}

/// A joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    pub name: String,
    pub kind: JointKind,
    pub parent: String,
    pub child: String,
    /// Pose of the child's frame in the parent's, with the joint at zero.
    pub parent_from_child: Isometry3<f64>,
    /// Axis in the child's frame.
    pub axis: UnitVector3<f64>,
    /// Joint that it follows.
    pub mimics: Option<String>,
}

/// A cylinder or a sphere of a link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Round {
    /// Pose in the link; a cylinder's axis is z.
    pub link_from_shape: Isometry3<f64>,
    /// Radius, m.
    pub radius_m: f64,
    /// True for a cylinder.
    pub has_axis: bool,
}

/// Commands that `ros2_control` or a transmission gives to a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Control {
    /// True if its position is commanded.
    pub steers: bool,
    /// True if its velocity or effort is commanded.
    pub drives: bool,
}

/// A URDF that is whole: one tree of links.
#[derive(Debug, Clone, PartialEq)]
pub struct Urdf {
    /// Round shapes by link; those for collisions where there are any.
    pub links: BTreeMap<String, Vec<Round>>,
    /// Joints in the order of the text.
    pub joints: Vec<Joint>,
    /// Controlled joints.
    pub controls: BTreeMap<String, Control>,
    /// Links that a simulated LiDAR is attached to.
    pub lidars: BTreeSet<String>,
}

impl Urdf {
    /// Returns the joint whose child a link is.
    pub fn joint_to(&self, link: &str) -> Option<&Joint> {
        self.joints.iter().find(|joint| joint.child == link)
    }

    /// Checks that links and joints are one tree.
    ///
    /// # Errors
    /// Names the joint or the links at fault.
    pub fn check(&self) -> Result<(), DescriptionRefused> {
        let mut children = BTreeSet::new();
        for joint in &self.joints {
            for (end, link) in [("parent", &joint.parent), ("child", &joint.child)] {
                if !self.links.contains_key(link) {
                    return Err(DescriptionRefused::Field {
                        field: format!("joint {:?}: {end} link", joint.name),
                        found: format!("{link:?}"),
                        expected: "a link of the URDF",
                    });
                }
            }
            if !children.insert(joint.child.as_str()) {
                return Err(DescriptionRefused::Field {
                    field: format!("joint {:?}: child link", joint.name),
                    found: format!("{:?}, the child of another joint too", joint.child),
                    expected: "one joint above each link",
                });
            }
        }
        let is_root = |link: &&String| !children.contains(link.as_str());
        let roots: Vec<&String> = self.links.keys().filter(is_root).take(3).collect();
        match roots.as_slice() {
            [_] => Ok(()),
            roots => Err(DescriptionRefused::Field {
                field: "links without a joint above them".to_owned(),
                found: match roots {
                    [] => "none".to_owned(),
                    roots => format!("{roots:?}"),
                },
                expected: "one, the root of the tree",
            }),
        }
    }
}

impl Round {
    /// Returns the direction of a cylinder's axis in the link.
    pub fn axis(&self) -> Option<Vector3<f64>> {
        let axis = || self.link_from_shape.rotation * Vector3::z();
        self.has_axis.then(axis)
    }
}
