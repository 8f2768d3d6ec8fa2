//! Axles of a vehicle, from the wheels that touch the ground.

use fleetcal_model::Pose2;

use crate::derived::Underivable;
use crate::ground::{Ground, Swivel, Wheel};

/// Largest distance between wheels of one axle along the vehicle, and of a centre wheel from the
/// centre line, m.
const LINE_MAX_M: f64 = 0.02;
/// The same over the track.
const LINE_MAX: f64 = 0.03;
/// Shortest wheelbase and track that are derived, m.
const APART_MIN_M: f64 = 0.03;

/// Axle whose wheels are not steered: the origin of a vehicle's motion.
#[derive(Debug, Clone)]
pub struct FixedAxle<'g> {
    /// Its wheels, the leftmost first.
    pub wheels: Vec<&'g Wheel>,
    /// Pose of its centre in the vehicle's frame.
    pub pose: Pose2,
    /// Distance between its outer wheels, m; 0 for one wheel.
    pub track_m: f64,
}

/// Steered axle.
#[derive(Debug, Clone)]
pub struct SteeredAxle<'g> {
    /// Joint at the centre, if there is one.
    pub centre: Option<&'g Swivel>,
    /// Joints beside it, the left one first.
    pub beside: Vec<&'g Swivel>,
    /// Distance ahead of the fixed axle, m.
    pub ahead_m: f64,
}

impl<'g> FixedAxle<'g> {
    /// Finds the axle.
    ///
    /// # Errors
    /// There is none, or more than one.
    pub fn of(ground: &'g Ground) -> Result<Self, Underivable> {
        let mut wheels: Vec<&Wheel> = ground.fixed.iter().collect();
        wheels.sort_by(|one, other| other.centre.y.total_cmp(&one.centre.y));
        let (Some(left), Some(right)) = (wheels.first(), wheels.last()) else {
            return Err(Underivable::new(
                "fixed axle",
                "no wheel that rolls without being steered",
                "continuous joints about a lateral axis, with wheels on the ground",
            ));
        };
        let track_m = left.centre.y - right.centre.y;
        let along = left.centre - right.centre;
        let is_pair = track_m > APART_MIN_M;
        let yaw_rad = if is_pair {
            (-along.x).atan2(along.y)
        } else {
            0.0
        };
        let pose = Pose2::new(
            f64::midpoint(left.centre.x, right.centre.x),
            f64::midpoint(left.centre.y, right.centre.y),
            yaw_rad,
        );
        let off = |wheel: &&&Wheel| ahead_m(&pose, wheel.centre.x, wheel.centre.y).abs();
        let is_off = |wheel: &&&Wheel| off(wheel) > line_max_m(track_m);
        // A slanted axle fits any two wheels: its yaw tells wheels that are behind each other.
        if wheels.iter().any(|wheel| is_off(&wheel)) || yaw_rad.abs() > 0.1 {
            let places: Vec<String> = wheels.iter().map(|wheel| placed(wheel)).collect();
            return Err(Underivable::new(
                "fixed axle",
                format!("wheels of several axles: {}", places.join(", ")),
                "one axle whose wheels are not steered",
            ));
        }
        Ok(Self {
            wheels,
            pose,
            track_m: if is_pair { track_m } else { 0.0 },
        })
    }

    /// Names of its joints.
    pub fn names(&self) -> String {
        let names: Vec<&str> = self
            .wheels
            .iter()
            .map(|wheel| wheel.joint.as_str())
            .collect();
        names.join(", ")
    }

    /// Distance of a point to the left of the axle's centre, m.
    pub fn left_m(&self, x_m: f64, y_m: f64) -> f64 {
        let point = Pose2::new(x_m, y_m, 0.0);
        self.pose.inverse().compose(&point).y_m
    }

    /// True if a distance to the left is at the centre.
    pub fn is_centre(&self, left_m: f64) -> bool {
        left_m.abs() <= line_max_m(self.track_m)
    }
}

impl<'g> SteeredAxle<'g> {
    /// Finds the axle.
    ///
    /// # Errors
    /// There is none, or more than one, or its wheels are not symmetric.
    pub fn of(ground: &'g Ground, fixed: &FixedAxle<'_>) -> Result<Self, Underivable> {
        let mut swivels = commanded(&ground.swivels);
        swivels.sort_by(|one, other| other.centre.y.total_cmp(&one.centre.y));
        let found = |text: String| {
            Underivable::new(
                "steering joint",
                text,
                "a joint about a vertical axis with a wheel below it: one at the centre, or one \
                 on either side",
            )
        };
        let names = || {
            let names: Vec<String> = swivels.iter().map(|swivel| placed_swivel(swivel)).collect();
            names.join(", ")
        };
        if swivels.is_empty() {
            return Err(found(
                "none: the vehicle is not steered by a wheel".to_owned(),
            ));
        }
        let ahead = |of: &Swivel| ahead_m(&fixed.pose, of.centre.x, of.centre.y);
        let all: Vec<f64> = swivels.iter().map(|swivel| ahead(swivel)).collect();
        let ahead_m = all.iter().sum::<f64>() / all.len() as f64;
        if all
            .iter()
            .any(|one| (one - ahead_m).abs() > line_max_m(fixed.track_m))
        {
            return Err(found(format!("joints of several axles: {}", names())));
        }
        if ahead_m.abs() < APART_MIN_M {
            return Err(found(format!(
                "joints on the fixed axle itself: {}",
                names()
            )));
        }
        let left_m = |of: &Swivel| fixed.left_m(of.centre.x, of.centre.y);
        let (centre, beside): (Vec<&Swivel>, Vec<&Swivel>) = swivels
            .iter()
            .partition(|swivel| fixed.is_centre(left_m(swivel)));
        let is_symmetric = match beside.as_slice() {
            [] => true,
            [left, right] => fixed.is_centre(left_m(left) + left_m(right)),
            _ => false,
        };
        if centre.len() > 1 || !is_symmetric {
            return Err(found(names()));
        }
        Ok(Self {
            centre: centre.first().copied(),
            beside,
            ahead_m,
        })
    }
}

/// Returns the joints whose position is commanded, with those that follow them; all if the
/// description does not say which are.
fn commanded(swivels: &[Swivel]) -> Vec<&Swivel> {
    let steers = |swivel: &&Swivel| swivel.control.is_some_and(|control| control.steers);
    let own: Vec<&Swivel> = swivels.iter().filter(steers).collect();
    if own.is_empty() {
        return swivels.iter().collect();
    }
    let follows = |swivel: &&Swivel| {
        own.iter()
            .any(|of| swivel.mimics.as_ref() == Some(&of.joint))
    };
    let all = swivels
        .iter()
        .filter(|swivel| steers(swivel) || follows(swivel));
    all.collect()
}

fn line_max_m(track_m: f64) -> f64 {
    LINE_MAX_M.max(LINE_MAX * track_m)
}

/// Distance of a point ahead of an axle, m.
fn ahead_m(axle: &Pose2, x_m: f64, y_m: f64) -> f64 {
    axle.inverse().compose(&Pose2::new(x_m, y_m, 0.0)).x_m
}

fn placed(wheel: &Wheel) -> String {
    let centre = wheel.centre;
    format!(
        "{} at x {:.3} m, y {:.3} m",
        wheel.joint, centre.x, centre.y
    )
}

fn placed_swivel(swivel: &Swivel) -> String {
    let centre = swivel.centre;
    format!(
        "{} at x {:.3} m, y {:.3} m",
        swivel.joint, centre.x, centre.y
    )
}
