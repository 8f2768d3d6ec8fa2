//! Nominal mount of the LiDAR.

use std::f64::consts::PI;

use fleetcal_model::{Pose2, wrap_angle_rad};
use nalgebra::{Isometry3, Vector3};

use crate::derived::{Derived, Underivable};
use crate::frames::Frames;
use crate::urdf::Urdf;

/// Least component of the scanning plane's normal along the vertical: 10 degrees.
const LEVEL_MIN: f64 = 0.985;
/// Words of which a LiDAR's link has one.
const WORDS: [&str; 14] = [
    "laser", "lidar", "scan", "scanner", "velodyne", "ouster", "hokuyo", "sick", "rplidar",
    "livox", "hesai", "rslidar", "lds", "pandar",
];
/// Name of the derived value.
const FIELD: &str = "nominal_extrinsics";

/// Pose of a LiDAR on its vehicle.
#[derive(Debug, Clone, PartialEq)]
pub struct LidarMount {
    /// Its frame.
    pub frame: String,
    /// Pose in the vehicle's frame, `base_link`, in the top view. The heading is that of the
    /// frame's x axis, also of a scanner upside down.
    pub in_base_link: Pose2,
    /// Pose in the rear axle's frame, `base`; `None` if the rear axle is unknown.
    pub in_base: Option<Pose2>,
    /// Height above the vehicle's frame, m.
    pub height_m: f64,
    /// Roll of half a turn: the scan's angles run clockwise in the top view.
    pub upside_down: bool,
}

impl LidarMount {
    /// Derives the mount of the frame that scans are in; without one, of the only LiDAR.
    ///
    /// # Errors
    /// The frame is unknown or tilted, or the LiDAR is ambiguous.
    pub fn of(
        urdf: Option<&Urdf>,
        frames: &Frames,
        scan_frame: Option<&str>,
        rear_axle: Option<&Pose2>,
    ) -> Result<Derived<Self>, Underivable> {
        let frame = match scan_frame.filter(|name| !name.is_empty()) {
            Some(name) => frames.resolve(name).map(str::to_owned).ok_or_else(|| {
                Underivable::new(
                    FIELD,
                    format!("scans in the frame {name:?}"),
                    "a link of the URDF or a frame of tf_static",
                )
            })?,
            None => only_lidar(urdf, frames)?,
        };
        let base_from_lidar = frames.base_from(&frame).ok_or_else(|| {
            Underivable::new(
                FIELD,
                format!(
                    "{frame}, which no chain of links joins to {}",
                    frames.base()
                ),
                "one tree of links and static transforms",
            )
        })?;
        let mount = Self::level(&frame, &base_from_lidar, rear_axle)?;
        let by = if frames.is_of_transforms(&frame) {
            "tf_static"
        } else {
            "URDF"
        };
        let source = format!("{by}: {frame} in {}", frames.base());
        Ok(Derived::new(mount, source))
    }

    fn level(
        frame: &str,
        base_from_lidar: &Isometry3<f64>,
        rear_axle: Option<&Pose2>,
    ) -> Result<Self, Underivable> {
        let up = base_from_lidar.rotation * Vector3::z();
        if up.z.abs() < LEVEL_MIN {
            let tilt_rad = up.z.abs().min(1.0).acos();
            return Err(Underivable::new(
                FIELD,
                format!("{frame} tilted by {:.0} degrees", tilt_rad.to_degrees()),
                "a scanning plane within 10 degrees of the ground's",
            ));
        }
        let forward = base_from_lidar.rotation * Vector3::x();
        let place = base_from_lidar.translation;
        let in_base_link = Pose2::new(place.x, place.y, forward.y.atan2(forward.x));
        let in_base = rear_axle.map(|axle| {
            let pose = axle.inverse().compose(&in_base_link);
            let yaw_rad = wrap_angle_rad(pose.yaw_rad);
            Pose2::new(pose.x_m, pose.y_m, yaw_rad)
        });
        Ok(Self {
            frame: frame.to_owned(),
            in_base_link,
            in_base,
            height_m: place.z,
            upside_down: up.z < 0.0,
        })
    }

    /// Sentence about a scanner upside down.
    pub(crate) fn remark(&self) -> Option<String> {
        let text = || {
            format!(
                "{} is upside down (roll {:.0} degrees): the angles of its scans run clockwise \
                 in the top view; have its driver publish them reversed, in a frame that is \
                 upright",
                self.frame,
                PI.to_degrees()
            )
        };
        self.upside_down.then(text)
    }
}

fn only_lidar(urdf: Option<&Urdf>, frames: &Frames) -> Result<String, Underivable> {
    let expected = "one LiDAR: a link or frame with laser, lidar or scan in its name, or with a \
                    simulated LiDAR";
    let simulated: Vec<&str> = urdf
        .into_iter()
        .flat_map(|urdf| urdf.lidars.iter().map(String::as_str))
        .collect();
    let mut found = simulated;
    if found.is_empty() {
        found = frames.names().filter(|name| is_named_so(name)).collect();
    }
    match found.as_slice() {
        [only] => Ok((*only).to_owned()),
        [] => Err(Underivable::new(FIELD, "no LiDAR", expected)),
        several => {
            let listed: Vec<&str> = several.iter().copied().take(8).collect();
            let text = format!("{} frames: {}", several.len(), listed.join(", "));
            Err(Underivable::new(FIELD, text, expected))
        }
    }
}

fn is_named_so(name: &str) -> bool {
    let mut chunks = name.split(|letter: char| !letter.is_ascii_alphabetic());
    chunks.any(|chunk| WORDS.contains(&chunk.to_ascii_lowercase().as_str()))
}
