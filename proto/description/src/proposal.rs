//! Proposal for a robot's configuration.

use fleetcal_model::{Pose2, SpeedMeasuredAt, VehicleModel};

use crate::chassis::{FixedAxle, SteeredAxle};
use crate::derived::{Derived, Underivable};
use crate::frames::Frames;
use crate::ground::{Ground, Wheel};
use crate::mount::LidarMount;
use crate::urdf::Urdf;

/// Largest relative difference of the radii of one axle's wheels.
const RADII_MAX: f64 = 0.01;
/// Frames at the centre of a rear axle, which are used without a URDF.
const REAR_AXLE_FRAMES: [&str; 4] = [
    "rear_axle",
    "rear_axle_link",
    "rear_axle_center",
    "rear_axle_centre",
];

/// Arrangement of a vehicle's steering.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layout {
    /// One steering joint at the centre, fixed wheels driven.
    Bicycle,
    /// One wheel at the centre, steered and driven.
    Tricycle,
    /// Two steered wheels, one on either side.
    Ackermann,
    /// Steered behind the fixed wheels, which are driven.
    RearSteered,
    /// One wheel behind the fixed ones, steered and driven.
    RearDriven,
}

impl Layout {
    /// Its name: `bicycle` and so on.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Bicycle => "bicycle",
            Self::Tricycle => "tricycle",
            Self::Ackermann => "ackermann",
            Self::RearSteered => "rear_steered",
            Self::RearDriven => "rear_driven",
        }
    }

    /// Model of the vehicle; of two steered wheels it has the centre's angle.
    pub const fn model(self) -> VehicleModel {
        match self {
            Self::Bicycle | Self::Ackermann => VehicleModel::Bicycle,
            Self::Tricycle => VehicleModel::Tricycle,
            Self::RearSteered | Self::RearDriven => VehicleModel::RearSteered,
        }
    }

    /// Place of the speed measurement, where it is not that of the model.
    pub const fn speed_measured_at(self) -> Option<SpeedMeasuredAt> {
        match self {
            Self::RearDriven => Some(SpeedMeasuredAt::SteeredWheel),
            Self::Bicycle | Self::Ackermann | Self::Tricycle | Self::RearSteered => None,
        }
    }
}

/// Joints of a `JointState`.
#[derive(Debug, Clone, PartialEq)]
pub struct Joints {
    /// Steering joints: that of the centre, or the left and the right one.
    pub steering: Vec<String>,
    /// Angle of the steered wheel, counter-clockwise positive, for each radian of the joint: 1 or -1.
    pub steering_gear: f64,
    /// Joints whose mean velocity is the speed.
    pub wheels: Vec<String>,
    /// 1 if they roll forwards with a positive velocity, -1 if backwards.
    pub wheel_gear: f64,
}

/// Configuration that a robot's description implies. What cannot be derived has its reason.
#[derive(Debug, Clone, PartialEq)]
pub struct Proposal {
    /// Arrangement of the steering.
    pub layout: Result<Derived<Layout>, Underivable>,
    /// Distance between the axles, m.
    pub wheelbase_m: Result<Derived<f64>, Underivable>,
    /// Distance between the outer wheels of the fixed axle, m.
    pub track_m: Result<Derived<f64>, Underivable>,
    /// Radius of the wheels that measure the speed, m.
    pub wheel_radius_m: Result<Derived<f64>, Underivable>,
    /// Joints that steer and drive.
    pub joints: Result<Derived<Joints>, Underivable>,
    /// Pose of the rear axle's centre in the vehicle's frame, `base_link`.
    pub rear_axle_in_base_link: Result<Derived<Pose2>, Underivable>,
    /// Mount of the LiDAR.
    pub lidar: Result<Derived<LidarMount>, Underivable>,
    /// Matters that a person has to know.
    pub remarks: Vec<String>,
}

impl Proposal {
    /// Derives it.
    pub(crate) fn of(urdf: Option<&Urdf>, frames: &Frames, scan_frame: Option<&str>) -> Self {
        let ground = urdf.map(|urdf| Ground::of(urdf, frames));
        let none = || Underivable::new("fixed axle", "no URDF", "a URDF (robot_description)");
        let fixed = ground.as_ref().ok_or_else(none).and_then(FixedAxle::of);
        let steered = match (&ground, &fixed) {
            (Some(ground), Ok(fixed)) => SteeredAxle::of(ground, fixed),
            (_, Err(refused)) => Err(refused.clone()),
            (None, _) => Err(none()),
        };
        let rear_axle = rear_axle(frames, fixed.as_ref(), urdf.is_some());
        let lidar = LidarMount::of(
            urdf,
            frames,
            scan_frame,
            rear_axle.as_ref().ok().map(|derived| &derived.value),
        );
        let both = fixed.as_ref().ok().zip(steered.as_ref().ok());
        let layout = match (&steered, both) {
            (_, Some((fixed, steered))) => layout(fixed, steered),
            (Err(refused), _) => Err(refused.of("model")),
            (Ok(_), None) => Err(none().of("model")),
        };
        let wheels = speed_wheels(both, layout.as_ref().map(|of| of.value));
        let mut remarks = frames.remarks.clone();
        remarks.extend(
            ground
                .iter()
                .flat_map(|ground| &ground.casters)
                .map(|of| format!("{of} is taken for a caster: its wheel trails behind the joint")),
        );
        remarks.extend(rear_steered(both));
        remarks.extend(lidar.as_ref().ok().and_then(|of| of.value.remark()));
        Self {
            wheelbase_m: wheelbase(steered.as_ref(), fixed.as_ref()),
            track_m: track(fixed.as_ref()),
            wheel_radius_m: wheels
                .as_ref()
                .map_err(|of| of.of("wheel_radius_m"))
                .and_then(|wheels| radius(wheels)),
            joints: match (&wheels, both) {
                (Ok(wheels), Some((_, steered))) => joints(steered, wheels),
                (Err(refused), _) => Err(refused.of("streams.joints")),
                (Ok(_), None) => Err(none().of("streams.joints")),
            },
            layout,
            rear_axle_in_base_link: rear_axle,
            lidar,
            remarks,
        }
    }
}

type Axles<'a, 'g> = Option<(&'a FixedAxle<'g>, &'a SteeredAxle<'g>)>;

fn rear_axle(
    frames: &Frames,
    fixed: Result<&FixedAxle<'_>, &Underivable>,
    has_urdf: bool,
) -> Result<Derived<Pose2>, Underivable> {
    let field = "rear_axle_in_base_link";
    match fixed {
        Ok(axle) => Ok(Derived::new(
            axle.pose,
            format!("URDF: middle of {} in {}", axle.names(), frames.base()),
        )),
        Err(refused) if has_urdf => Err(refused.of(field)),
        Err(refused) => {
            let placed = REAR_AXLE_FRAMES
                .iter()
                .find_map(|name| Some((name, frames.base_from(frames.resolve(name)?)?)));
            let (name, pose) = placed.ok_or_else(|| refused.of(field))?;
            let (place, (_, _, yaw_rad)) = (pose.translation, pose.rotation.euler_angles());
            Ok(Derived::new(
                Pose2::new(place.x, place.y, yaw_rad),
                format!("tf_static: {name} in {}", frames.base()),
            ))
        }
    }
}

fn wheelbase(
    steered: Result<&SteeredAxle<'_>, &Underivable>,
    fixed: Result<&FixedAxle<'_>, &Underivable>,
) -> Result<Derived<f64>, Underivable> {
    let field = "wheelbase_m";
    let fixed = fixed.map_err(|refused| refused.of(field))?;
    let steered = steered.map_err(|refused| refused.of(field))?;
    let source = format!("URDF: {} to {}", fixed.names(), steered_names(steered));
    Ok(Derived::new(steered.ahead_m.abs(), source))
}

fn track(fixed: Result<&FixedAxle<'_>, &Underivable>) -> Result<Derived<f64>, Underivable> {
    let fixed = fixed.map_err(|refused| refused.of("track_m"))?;
    if fixed.track_m > 0.0 {
        let source = format!("URDF: {}", fixed.names());
        return Ok(Derived::new(fixed.track_m, source));
    }
    Err(Underivable::new(
        "track_m",
        format!("one wheel on the fixed axle: {}", fixed.names()),
        "two wheels beside each other",
    ))
}

fn steered_names(steered: &SteeredAxle<'_>) -> String {
    let joints = match steered.centre {
        Some(centre) => vec![centre],
        None => steered.beside.clone(),
    };
    let names: Vec<&str> = joints.iter().map(|joint| joint.joint.as_str()).collect();
    names.join(", ")
}

fn layout(
    fixed: &FixedAxle<'_>,
    steered: &SteeredAxle<'_>,
) -> Result<Derived<Layout>, Underivable> {
    let names = steered_names(steered);
    let (beside, central, driven) = if steered.ahead_m < 0.0 {
        (Layout::RearSteered, Layout::RearSteered, Layout::RearDriven)
    } else {
        (Layout::Ackermann, Layout::Bicycle, Layout::Tricycle)
    };
    let Some(centre) = steered.centre else {
        let source = format!("URDF: steered on either side by {names}");
        return Ok(Derived::new(beside, source));
    };
    let steered_drives = centre.wheels.iter().any(|wheel| wheel.control.drives);
    let fixed_drives = fixed.wheels.iter().any(|wheel| wheel.control.drives);
    let cannot_drive = centre.wheels.is_empty() || !steered.beside.is_empty();
    match (steered_drives, fixed_drives) {
        (true, false) => Ok(Derived::new(
            driven,
            format!("URDF: the wheel steered by {names} is driven"),
        )),
        (false, true) => Ok(Derived::new(
            central,
            format!(
                "URDF: steered at the centre by {names}, driven by {}",
                fixed.names()
            ),
        )),
        (false, false) if cannot_drive => Ok(Derived::new(
            central,
            format!("URDF: steered at the centre by {names}, whose wheel has no joint to drive it"),
        )),
        (both, _) => Err(Underivable::new(
            "model",
            format!(
                "{} driven joint among {} and {}",
                if both { "more than one" } else { "no" },
                fixed.names(),
                centre
                    .wheels
                    .iter()
                    .map(|of| of.joint.as_str())
                    .collect::<Vec<_>>()
                    .join(", ")
            ),
            "a velocity command interface in ros2_control, or a transmission, of either the \
             steered wheel (tricycle) or the fixed ones (bicycle)",
        )),
    }
}

/// Returns the wheels whose mean is the speed.
fn speed_wheels<'g>(
    axles: Axles<'_, 'g>,
    layout: Result<Layout, &Underivable>,
) -> Result<Vec<&'g Wheel>, Underivable> {
    let field = "speed wheels";
    let layout = layout.map_err(|refused| refused.of(field))?;
    let Some((fixed, steered)) = axles else {
        return Err(Underivable::new(
            field,
            "no axles",
            "a fixed and a steered axle",
        ));
    };
    let all: Vec<&Wheel> = match (layout, steered.centre) {
        (Layout::Tricycle | Layout::RearDriven, Some(centre)) => centre.wheels.iter().collect(),
        _ => fixed.wheels.clone(),
    };
    let driven = |wheel: &&&Wheel| wheel.control.drives;
    let own = |wheel: &&&Wheel| !wheel.is_mimic;
    let mut wheels: Vec<&Wheel> = all.iter().filter(driven).copied().collect();
    if wheels.is_empty() {
        wheels = all.iter().filter(own).copied().collect();
    }
    if wheels.is_empty() {
        wheels = all;
    }
    let names: Vec<&str> = wheels.iter().map(|wheel| wheel.joint.as_str()).collect();
    let lateral = wheels
        .iter()
        .map(|of| fixed.left_m(of.centre.x, of.centre.y));
    let mean_m = lateral.sum::<f64>() / wheels.len() as f64;
    if !fixed.is_centre(mean_m) {
        return Err(Underivable::new(
            field,
            format!(
                "{}, whose mean is {mean_m:.3} m to the left",
                names.join(", ")
            ),
            "a wheel at the centre, or one on either side",
        ));
    }
    let sense = wheels.iter().map(|wheel| wheel.sense).sum::<f64>().abs();
    if sense < wheels.len() as f64 {
        return Err(Underivable::new(
            field,
            format!(
                "{}, which roll forwards with opposite signs",
                names.join(", ")
            ),
            "axes that point to the same side",
        ));
    }
    Ok(wheels)
}

fn radius(wheels: &[&Wheel]) -> Result<Derived<f64>, Underivable> {
    let field = "wheel_radius_m";
    let mut known: Vec<(f64, &str)> = Vec::new();
    for wheel in wheels {
        let radius = wheel.radius.as_ref().ok_or_else(|| {
            Underivable::new(
                field,
                format!("{} without a radius", wheel.joint),
                "a cylinder or sphere as the wheel's collision or visual shape, or a \
                 base_footprint on the ground",
            )
        })?;
        known.push((radius.metres, &radius.source));
    }
    let (first, source) = known.first().copied().unwrap_or_default();
    let differs = |other: &&(f64, &str)| (other.0 - first).abs() > RADII_MAX * first;
    if let Some((other, of)) = known.iter().find(differs) {
        return Err(Underivable::new(
            field,
            format!("{first:.4} m of {source} and {other:.4} m of {of}"),
            "one radius of both",
        ));
    }
    let sources: Vec<&str> = known.iter().map(|of| of.1).collect();
    Ok(Derived::new(first, format!("URDF: {}", sources.join(", "))))
}

fn joints(steered: &SteeredAxle<'_>, wheels: &[&Wheel]) -> Result<Derived<Joints>, Underivable> {
    let swivels = match steered.centre {
        Some(centre) => vec![centre],
        None => steered.beside.clone(),
    };
    let sense = swivels.first().map_or(1.0, |first| first.sense);
    if swivels
        .iter()
        .any(|swivel| (swivel.sense - sense).abs() > 0.5)
    {
        return Err(Underivable::new(
            "streams.joints",
            format!("{}, which turn to opposite sides", steered_names(steered)),
            "steering axes that point the same way",
        ));
    }
    let names = |of: &[&Wheel]| {
        of.iter()
            .map(|wheel| wheel.joint.clone())
            .collect::<Vec<_>>()
    };
    let joints = Joints {
        steering: swivels.iter().map(|swivel| swivel.joint.clone()).collect(),
        steering_gear: sense,
        wheels: names(wheels),
        wheel_gear: wheels.first().map_or(1.0, |wheel| wheel.sense),
    };
    let source = format!(
        "URDF: axes of {} and {}",
        joints.steering.join(", "),
        joints.wheels.join(", ")
    );
    Ok(Derived::new(joints, source))
}

fn rear_steered(axles: Axles<'_, '_>) -> Option<String> {
    let (fixed, steered) = axles.filter(|(_, steered)| steered.ahead_m < 0.0)?;
    Some(format!(
        "the steered axle ({}) is behind the fixed one ({}): an angle to the left turns the \
         vehicle to the right, and `base` is the fixed axle",
        steered_names(steered),
        fixed.names()
    ))
}
