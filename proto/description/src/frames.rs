//! Frames of a robot: the links of its URDF with all joints at zero, and its static transforms.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

use crate::urdf::Urdf;
use crate::{DescriptionRefused, LINKS_MAX, NAME_BYTES_MAX, STATIC_TRANSFORMS_MAX};

/// Usual name of a vehicle's frame.
const BASE_LINK: &str = "base_link";
/// Largest distance, m, and angle, rad, between a URDF and a static transform that agree.
const AGREEMENT: (f64, f64) = (0.005, 0.009);

/// Pose of a frame in another one, as `/tf_static` has it.
#[derive(Debug, Clone, PartialEq)]
pub struct StaticTransform {
    /// The other frame.
    pub parent: String,
    /// The frame.
    pub child: String,
    /// Position of the child in the parent, m.
    pub translation_m: [f64; 3],
    /// Orientation of the child in the parent, a unit quaternion x, y, z, w.
    pub rotation: [f64; 4],
}

impl StaticTransform {
    /// Checks names and numbers, and strips the slash that frames once began with.
    pub(crate) fn checked(self) -> Result<Self, DescriptionRefused> {
        let named = |of: &str, name: &str| {
            let name = name.trim_start_matches('/');
            if !name.is_empty() && name.len() <= NAME_BYTES_MAX {
                return Ok(name.to_owned());
            }
            Err(DescriptionRefused::Field {
                field: format!("tf_static: {of}"),
                found: format!("{} bytes", name.len()),
                expected: "a name of 1 to 200 bytes",
            })
        };
        let (parent, child) = (
            named("header.frame_id", &self.parent)?,
            named("child_frame_id", &self.child)?,
        );
        let [x, y, z, w] = self.rotation;
        let norm = Quaternion::new(w, x, y, z).norm();
        let is_finite = self.translation_m.iter().all(|metres| metres.is_finite());
        if !is_finite || !(0.99..=1.01).contains(&norm) || parent == child {
            return Err(DescriptionRefused::Field {
                field: format!("tf_static: transform of {child:?}"),
                found: format!("{:?} m and {:?}", self.translation_m, self.rotation),
                expected: "finite metres and a unit quaternion, in another frame",
            });
        }
        Ok(Self {
            parent,
            child,
            ..self
        })
    }

    fn parent_from_child(&self) -> Isometry3<f64> {
        let [x, y, z, w] = self.rotation;
        Isometry3::from_parts(
            Translation3::from(self.translation_m),
            UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)),
        )
    }
}

/// Frame above another one.
#[derive(Debug)]
struct Above {
    parent: String,
    parent_from_child: Isometry3<f64>,
    is_static_transform: bool,
}

/// All frames.
#[derive(Debug)]
pub struct Frames {
    above: BTreeMap<String, Above>,
    base: String,
    /// Contradictions between the URDF and static transforms.
    pub remarks: Vec<String>,
}

impl Frames {
    /// Combines a URDF and static transforms; the URDF is preferred.
    pub fn of(urdf: Option<&Urdf>, transforms: &[StaticTransform]) -> Self {
        let mut above = BTreeMap::new();
        for joint in urdf.into_iter().flat_map(|urdf| &urdf.joints) {
            let edge = Above {
                parent: joint.parent.clone(),
                parent_from_child: joint.parent_from_child,
                is_static_transform: false,
            };
            above.insert(joint.child.clone(), edge);
        }
        let mut frames = Self {
            above,
            base: String::new(),
            remarks: Vec::new(),
        };
        for transform in transforms {
            frames.add(transform);
        }
        frames.base = frames.find_base(urdf);
        frames
    }

    fn add(&mut self, transform: &StaticTransform) {
        let is_known = |name: &str| {
            let names = self.above.iter();
            names
                .into_iter()
                .any(|(child, above)| child == name || above.parent == name)
        };
        // A publisher may put the robot's name before the names of the URDF.
        let own_name = |name: &str| match name.rsplit_once('/') {
            Some((_, last)) if !is_known(name) && is_known(last) => last.to_owned(),
            _ => name.to_owned(),
        };
        let (parent, child) = (own_name(&transform.parent), own_name(&transform.child));
        let pose = transform.parent_from_child();
        if let Some(known) = self.above.get(&child) {
            let same_parent = known.parent == parent;
            let (metres, radians) = apart(&known.parent_from_child, &pose);
            if same_parent && (metres > AGREEMENT.0 || radians > AGREEMENT.1) {
                self.remarks.push(format!(
                    "{child} is in {parent} elsewhere by tf_static than by the URDF, {:.0} mm and \
                     {:.1} degrees away: the URDF's pose is used",
                    metres * 1e3,
                    radians.to_degrees()
                ));
            }
            return;
        }
        let edge = Above {
            parent,
            parent_from_child: pose,
            is_static_transform: true,
        };
        self.above.insert(child, edge);
    }

    /// Name of the vehicle's frame.
    pub fn base(&self) -> &str {
        &self.base
    }

    fn find_base(&self, urdf: Option<&Urdf>) -> String {
        let links = urdf.into_iter().flat_map(|urdf| urdf.links.keys());
        let children = self.above.keys();
        let parents = self.above.values().map(|above| &above.parent);
        let names = || links.clone().chain(children.clone()).chain(parents.clone());
        let is_base = |name: &&String| name.as_str() == BASE_LINK;
        let ends_so = |name: &&String| name.ends_with(BASE_LINK);
        let base = names().find(is_base).or_else(|| names().find(ends_so));
        let base = base.or_else(|| names().find(|name| !self.above.contains_key(*name)));
        base.cloned().unwrap_or_else(|| BASE_LINK.to_owned())
    }

    /// Returns the frame's own name: the robot's name may stand before that of the URDF.
    pub fn resolve<'n>(&self, name: &'n str) -> Option<&'n str> {
        let name = name.trim_start_matches('/');
        let last = name.rsplit('/').next().unwrap_or(name);
        let is_known = |name: &&str| {
            self.above.contains_key(*name)
                || self.above.values().any(|above| above.parent == **name)
        };
        [name, last].into_iter().find(is_known)
    }

    /// Pose of a frame in the vehicle's frame; `None` if no chain joins them.
    pub fn base_from(&self, name: &str) -> Option<Isometry3<f64>> {
        let (root, root_from_base) = self.root_from(&self.base)?;
        let (other_root, root_from_frame) = self.root_from(name)?;
        (root == other_root).then(|| root_from_base.inverse() * root_from_frame)
    }

    /// True if the frame's pose comes from a static transform.
    pub fn is_of_transforms(&self, name: &str) -> bool {
        self.above
            .get(name)
            .is_some_and(|above| above.is_static_transform)
    }

    fn root_from<'f>(&'f self, name: &'f str) -> Option<(&'f str, Isometry3<f64>)> {
        let (mut at, mut at_from_frame) = (name, Isometry3::identity());
        for _ in 0..=LINKS_MAX + STATIC_TRANSFORMS_MAX {
            let Some(above) = self.above.get(at) else {
                return Some((at, at_from_frame));
            };
            at_from_frame = above.parent_from_child * at_from_frame;
            at = &above.parent;
        }
        None
    }

    /// All frames that have one above them.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.above.keys().map(String::as_str)
    }
}

fn apart(one: &Isometry3<f64>, other: &Isometry3<f64>) -> (f64, f64) {
    let between = one.inverse() * other;
    (between.translation.vector.norm(), between.rotation.angle())
}
