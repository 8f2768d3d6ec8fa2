//! Parts of a vehicle that touch the ground: wheels that roll, and joints that swivel them.

use nalgebra::{Isometry3, Point3, Vector3};

use crate::frames::Frames;
use crate::urdf::{Control, Joint, JointKind, Urdf};

/// Least component of an axis along the direction it is taken for: 20 degrees off.
const ALONG_MIN: f64 = 0.94;
/// Largest height of a wheel's lowest point above the lowest of all, over its radius.
const LIFT_MAX: f64 = 0.3;
/// Largest height of a wheel of unknown radius above the lowest such wheel, m.
const LIFT_WITHOUT_RADIUS_MAX_M: f64 = 0.05;
/// Farthest a wheel's centre is ahead of or behind the axis that steers it, over its radius: a
/// caster trails by more.
const TRAIL_MAX: f64 = 0.3;
/// The same for a wheel of unknown radius, m.
const TRAIL_WITHOUT_RADIUS_MAX_M: f64 = 0.03;
/// Usual name of the frame on the ground below the vehicle.
const FOOTPRINT: &str = "base_footprint";

/// Radius of a wheel.
#[derive(Debug, Clone, PartialEq)]
pub struct Radius {
    pub metres: f64,
    /// Link that has it.
    pub source: String,
}

/// A wheel with a joint that it rolls about.
#[derive(Debug, Clone, PartialEq)]
pub struct Wheel {
    pub joint: String,
    pub centre: Point3<f64>,
    /// 1 if it rolls forwards with a positive velocity, -1 if backwards.
    pub sense: f64,
    pub radius: Option<Radius>,
    pub is_mimic: bool,
    pub control: Control,
    /// The joint that steers it.
    pub swivel: Option<String>,
}

/// A joint about a vertical axis with a wheel below it.
#[derive(Debug, Clone, PartialEq)]
pub struct Swivel {
    pub joint: String,
    /// Centre of its wheel in the vehicle's frame.
    pub centre: Point3<f64>,
    /// 1 if it turns to the left with a positive angle, -1 if to the right.
    pub sense: f64,
    pub mimics: Option<String>,
    pub control: Option<Control>,
    /// Joints of its wheels that roll.
    pub wheels: Vec<Wheel>,
}

/// Ground contacts of a vehicle.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Ground {
    /// Wheels that are not steered.
    pub fixed: Vec<Wheel>,
    pub swivels: Vec<Swivel>,
    /// Joints of casters.
    pub casters: Vec<String>,
}

/// A joint in the vehicle's frame.
struct Placed<'u> {
    joint: &'u Joint,
    base_from_child: Isometry3<f64>,
    axis: Vector3<f64>,
}

impl<'u> Placed<'u> {
    fn of(joint: &'u Joint, frames: &Frames) -> Option<Self> {
        let base_from_child = frames.base_from(&joint.child)?;
        Some(Self {
            joint,
            base_from_child,
            axis: base_from_child.rotation * joint.axis.into_inner(),
        })
    }

    fn turns_about_vertical(&self) -> bool {
        self.joint.kind != JointKind::Other && self.axis.z.abs() > ALONG_MIN
    }
}

impl Ground {
    /// Finds what touches the ground.
    pub fn of(urdf: &Urdf, frames: &Frames) -> Self {
        let joints: Vec<Placed<'_>> = urdf
            .joints
            .iter()
            .filter_map(|joint| Placed::of(joint, frames))
            .collect();
        let rolling = joints
            .iter()
            .filter(|of| of.joint.kind == JointKind::Continuous && of.axis.y.abs() > ALONG_MIN);
        let wheels = rolling.map(|of| wheel(urdf, frames, of)).collect();
        let wheels = on_ground(wheels);
        let turning = joints.iter().filter(|of| of.turns_about_vertical());
        let mut ground = Self::default();
        for of in turning {
            ground.add_swivel(urdf, of, &wheels);
        }
        let is_fixed = |wheel: &Wheel| wheel.swivel.is_none();
        ground.fixed = wheels.into_iter().filter(is_fixed).collect();
        ground
    }

    fn add_swivel(&mut self, urdf: &Urdf, of: &Placed<'_>, wheels: &[Wheel]) {
        let name = &of.joint.name;
        let is_below = |wheel: &&Wheel| wheel.swivel.as_ref() == Some(name);
        let below: Vec<Wheel> = wheels.iter().filter(is_below).cloned().collect();
        let own = own_wheel(urdf, of);
        let mean = |values: Vec<f64>| values.iter().sum::<f64>() / values.len() as f64;
        let (centre, radius_m) = if let Some(first) = below.first() {
            let along = |axis: usize| mean(below.iter().map(|wheel| wheel.centre[axis]).collect());
            let radius_m = first.radius.as_ref().map(|radius| radius.metres);
            (Point3::new(along(0), along(1), along(2)), radius_m)
        } else if let Some((centre, radius_m)) = own {
            (centre, Some(radius_m))
        } else {
            return;
        };
        let trail_m = (centre.x - of.base_from_child.translation.x).abs();
        let trail_max_m =
            radius_m.map_or(TRAIL_WITHOUT_RADIUS_MAX_M, |radius_m| TRAIL_MAX * radius_m);
        if trail_m > trail_max_m {
            self.casters.push(name.clone());
            return;
        }
        self.swivels.push(Swivel {
            joint: name.clone(),
            centre,
            sense: of.axis.z.signum(),
            mimics: of.joint.mimics.clone(),
            control: urdf.controls.get(name).copied(),
            wheels: below,
        });
    }
}

fn wheel(urdf: &Urdf, frames: &Frames, of: &Placed<'_>) -> Wheel {
    let centre = Point3::from(of.base_from_child.translation.vector);
    let by_shape = || {
        let shapes = urdf.links.get(&of.joint.child)?;
        let is_about = |axis: Option<Vector3<f64>>| {
            axis.is_none_or(|axis| axis.dot(&of.joint.axis).abs() > ALONG_MIN)
        };
        let shape = shapes.iter().find(|shape| is_about(shape.axis()))?;
        Some(Radius {
            metres: shape.radius_m,
            source: of.joint.child.clone(),
        })
    };
    let by_height = || {
        let floor = frames.base_from(FOOTPRINT)?;
        let metres = centre.z - floor.translation.z;
        (metres > 0.0).then(|| Radius {
            metres,
            source: format!("height of {} above {FOOTPRINT}", of.joint.child),
        })
    };
    Wheel {
        joint: of.joint.name.clone(),
        centre,
        sense: of.axis.y.signum(),
        radius: by_shape().or_else(by_height),
        is_mimic: of.joint.mimics.is_some(),
        control: urdf
            .controls
            .get(&of.joint.name)
            .copied()
            .unwrap_or_default(),
        swivel: swivel_above(urdf, frames, of.joint),
    }
}

/// Returns the nearest joint above another one that turns about a vertical axis.
fn swivel_above(urdf: &Urdf, frames: &Frames, joint: &Joint) -> Option<String> {
    let mut above = urdf.joint_to(&joint.parent);
    for _ in 0..urdf.joints.len() {
        let joint = above?;
        if Placed::of(joint, frames)?.turns_about_vertical() {
            return Some(joint.name.clone());
        }
        above = urdf.joint_to(&joint.parent);
    }
    None
}

/// Returns centre and radius of the wheel that a turning link itself is.
fn own_wheel(urdf: &Urdf, of: &Placed<'_>) -> Option<(Point3<f64>, f64)> {
    let shapes = urdf.links.get(&of.joint.child)?;
    shapes.iter().find_map(|shape| {
        let axis = of.base_from_child.rotation * shape.axis()?;
        let centre = of.base_from_child * shape.link_from_shape * Point3::origin();
        (axis.y.abs() > ALONG_MIN).then_some((centre, shape.radius_m))
    })
}

/// Keeps the wheels whose lowest points are about as low as the lowest.
fn on_ground(mut wheels: Vec<Wheel>) -> Vec<Wheel> {
    let bottom = |wheel: &Wheel| {
        let radius = wheel.radius.as_ref()?;
        Some(wheel.centre.z - radius.metres)
    };
    let lowest = wheels.iter().filter_map(bottom).reduce(f64::min);
    let is_bare = |wheel: &&Wheel| wheel.radius.is_none();
    let bare = wheels.iter().filter(is_bare).map(|wheel| wheel.centre.z);
    let lowest_bare = bare.reduce(f64::min);
    wheels.retain(|wheel| match (&wheel.radius, lowest, lowest_bare) {
        (Some(radius), Some(lowest), _) => {
            wheel.centre.z - radius.metres - lowest <= LIFT_MAX * radius.metres
        }
        (None, _, Some(lowest)) => wheel.centre.z - lowest <= LIFT_WITHOUT_RADIUS_MAX_M,
        _ => true,
    });
    wheels
}
