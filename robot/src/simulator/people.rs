//! People who walk from one random place to the next.

use std::f64::consts::{PI, TAU};

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::plane::Point;
use super::random::{Stream, stream};
use super::shape::Area;

/// Largest number of people in a simulation.
pub const PEOPLE_MAX: usize = 60;
/// Least distance of people from the LiDAR, m: they step aside for a robot.
const KEEP_CLEAR_M: f64 = 0.9;
/// Radius of a shin at the height of a LiDAR, m.
const LEG_RADIUS_M: f64 = 0.07;
/// Radius of a person seen as one cylinder, m.
const CYLINDER_RADIUS_M: f64 = 0.22;
/// Half the distance between the legs, m.
const HALF_STANCE_M: f64 = 0.1;
/// Amplitude of a leg's swing to the front and back, m.
const SWING_M: f64 = 0.28;
/// Length of two steps, m.
const STRIDE_M: f64 = 1.4;

/// Shape of a person for the LiDAR.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum PersonShape {
    /// Two swinging legs.
    #[default]
    Legs,
    /// One cylinder.
    Cylinder,
}

/// The people in a world.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct PeopleSettings {
    /// Number of people; at most 60.
    pub count: usize,
    /// Their shape.
    pub shape: PersonShape,
}

/// A leg or a body at one moment.
#[derive(Debug, Clone, Copy)]
pub(super) struct Disc {
    pub centre: Point,
    pub radius_m: f64,
}

#[derive(Debug)]
struct Walker {
    area: Area,
    from: Point,
    to: Point,
    start_s: f64,
    arrival_s: f64,
    /// Start of the next leg of the way: people stand for a while.
    departure_s: f64,
    random: ChaCha8Rng,
}

/// All people in the world. Time must not run backwards.
#[derive(Debug)]
pub(super) struct Crowd {
    walkers: Vec<Walker>,
    shape: PersonShape,
}

impl Crowd {
    pub fn new(settings: PeopleSettings, seed: u64, walkable: &[Area]) -> Self {
        let mut random = stream(seed, Stream::People);
        let walkers = (0..settings.count)
            .filter_map(|_| {
                Some(Walker::new(
                    pick_area(walkable, &mut random)?,
                    random.random(),
                ))
            })
            .collect();
        Self {
            walkers,
            shape: settings.shape,
        }
    }

    pub fn is_empty(&self) -> bool {
        self.walkers.is_empty()
    }

    /// Puts the discs of all people at a time into `discs`; always in the same order.
    pub fn discs_at(&mut self, time_s: f64, lidar: Point, discs: &mut Vec<Disc>) {
        discs.clear();
        for walker in &mut self.walkers {
            walker.advance_to(time_s);
            match self.shape {
                PersonShape::Legs => discs.extend(walker.legs(time_s)),
                PersonShape::Cylinder => discs.push(Disc {
                    centre: walker.position(time_s),
                    radius_m: CYLINDER_RADIUS_M,
                }),
            }
        }
        for disc in discs {
            disc.centre = aside(disc.centre, lidar);
        }
    }
}

/// Draws an area by surface, so that people spread evenly.
fn pick_area(walkable: &[Area], random: &mut ChaCha8Rng) -> Option<Area> {
    let total_m2: f64 = walkable.iter().map(Area::surface_m2).sum();
    let mut left_m2 = random.random_range(0.0..1.0) * total_m2;
    for area in walkable {
        left_m2 -= area.surface_m2();
        if left_m2 <= 0.0 {
            return Some(*area);
        }
    }
    walkable.last().copied()
}

/// Moves a point away from the LiDAR as far as people step aside.
pub(super) fn aside(point: Point, lidar: Point) -> Point {
    let distance_m = point.distance_m(lidar);
    if distance_m >= KEEP_CLEAR_M {
        point
    } else if distance_m < 1e-6 {
        Point::new(lidar.x_m + KEEP_CLEAR_M, lidar.y_m)
    } else {
        lidar.toward(point, KEEP_CLEAR_M / distance_m)
    }
}

impl Walker {
    fn new(area: Area, seed: u64) -> Self {
        let random = stream(seed, Stream::People);
        let start = Point::default();
        let mut walker = Self {
            area,
            from: start,
            to: start,
            start_s: 0.0,
            arrival_s: 0.0,
            departure_s: 0.0,
            random,
        };
        walker.to = walker.any_place();
        walker
    }

    fn any_place(&mut self) -> Point {
        let (across, along) = (self.random.random(), self.random.random::<f64>());
        Point::new(
            self.area.min.toward(self.area.max, across).x_m,
            self.area.min.toward(self.area.max, along).y_m,
        )
    }

    fn advance_to(&mut self, time_s: f64) {
        while time_s >= self.departure_s {
            self.from = self.to;
            self.to = self.any_place();
            self.start_s = self.departure_s;
            let speed_mps = self.random.random_range(0.6..1.5);
            self.arrival_s = self.start_s + self.from.distance_m(self.to) / speed_mps;
            self.departure_s = self.arrival_s + self.random.random_range(0.2..4.0);
        }
    }

    fn fraction(&self, time_s: f64) -> f64 {
        let duration_s = (self.arrival_s - self.start_s).max(1e-3);
        ((time_s - self.start_s) / duration_s).clamp(0.0, 1.0)
    }

    fn position(&self, time_s: f64) -> Point {
        self.from.toward(self.to, self.fraction(time_s))
    }

    fn legs(&self, time_s: f64) -> [Disc; 2] {
        let position = self.position(time_s);
        let walked_m = self.fraction(time_s) * self.from.distance_m(self.to);
        let heading_rad = (self.to.y_m - self.from.y_m).atan2(self.to.x_m - self.from.x_m);
        let (sin, cos) = heading_rad.sin_cos();
        let leg = |side: f64, phase_rad: f64| {
            let ahead_m = SWING_M * (TAU * walked_m / STRIDE_M + phase_rad).sin();
            let left_m = side * HALF_STANCE_M;
            let centre = Point::new(
                position.x_m + cos * ahead_m - sin * left_m,
                position.y_m + sin * ahead_m + cos * left_m,
            );
            Disc {
                centre,
                radius_m: LEG_RADIUS_M,
            }
        };
        [leg(1.0, 0.0), leg(-1.0, PI)]
    }
}
