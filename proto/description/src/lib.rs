//! Descriptions that robots publish of themselves: a URDF (`/robot_description`) and static
//! transforms (`/tf_static`).
//!
//! [`Description::propose`] derives from them what a configuration would otherwise be typed from:
//! steering geometry, wheelbase, track, wheel radius, joints, the rear axle in `base_link` and the
//! nominal mount of the LiDAR. Each value has its source, and each value that cannot be derived its
//! reason. Frames follow REP 103: x forward, y to the left, z up.

mod chassis;
mod derived;
mod frames;
mod ground;
mod mount;
mod proposal;
mod refused;
mod urdf;
mod xml;

pub use derived::{Derived, Underivable};
pub use frames::StaticTransform;
pub use mount::LidarMount;
pub use proposal::{Joints, Layout, Proposal};
pub use refused::DescriptionRefused;

use frames::Frames;
use urdf::Urdf;

/// Largest URDF that is read, bytes.
pub const URDF_BYTES_MAX: usize = 4 << 20;
/// Most elements, texts and comments of a URDF.
pub const NODES_MAX: u32 = 200_000;
/// Most links of a URDF, and most joints.
pub const LINKS_MAX: usize = 2_048;
/// Most static transforms that are kept beside a URDF.
pub const STATIC_TRANSFORMS_MAX: usize = 2_048;
/// Longest name of a link, a joint or a frame, bytes.
pub const NAME_BYTES_MAX: usize = 200;

/// Description of a robot's build: its URDF and its static transforms.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Description {
    urdf: Option<Urdf>,
    transforms: Vec<StaticTransform>,
}

impl Description {
    /// Reads a URDF, in place of the one before; static transforms are kept.
    ///
    /// # Errors
    /// The text is no XML, no expanded URDF, too large, or contradicts itself.
    pub fn set_urdf(&mut self, text: &str) -> Result<(), DescriptionRefused> {
        self.urdf = Some(xml::read(text)?);
        Ok(())
    }

    /// Adds a static transform; one of the same child replaces the one before.
    ///
    /// # Errors
    /// A name or a number is impossible, or there are too many.
    pub fn add_transform(&mut self, transform: StaticTransform) -> Result<(), DescriptionRefused> {
        let transform = transform.checked()?;
        let known = self.transforms.iter_mut();
        if let Some(same) = known
            .into_iter()
            .find(|known| known.child == transform.child)
        {
            *same = transform;
            return Ok(());
        }
        if self.transforms.len() >= STATIC_TRANSFORMS_MAX {
            return Err(DescriptionRefused::TooMany {
                what: "static transforms",
                limit: STATIC_TRANSFORMS_MAX,
            });
        }
        self.transforms.push(transform);
        Ok(())
    }

    /// True if there is neither a URDF nor a transform.
    pub fn is_empty(&self) -> bool {
        self.urdf.is_none() && self.transforms.is_empty()
    }

    /// True if there is a URDF.
    pub fn has_urdf(&self) -> bool {
        self.urdf.is_some()
    }

    /// Derives a robot's configuration. `scan_frame` is the frame of its scans, where known.
    pub fn propose(&self, scan_frame: Option<&str>) -> Proposal {
        let frames = Frames::of(self.urdf.as_ref(), &self.transforms);
        Proposal::of(self.urdf.as_ref(), &frames, scan_frame)
    }
}
