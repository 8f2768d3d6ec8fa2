//! Shapes that a world is made of.

use serde::{Deserialize, Serialize};

use super::plane::Point;

/// A straight piece of wall, or one side of a box.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Segment {
    /// One end.
    pub from: Point,
    /// The other end.
    pub to: Point,
}

/// A round pillar.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pillar {
    /// Its middle.
    pub centre: Point,
    /// Its radius, m.
    pub radius_m: f64,
}

/// A rectangle along the world's axes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Area {
    /// The corner with the smallest coordinates.
    pub min: Point,
    /// The corner with the largest coordinates.
    pub max: Point,
}

impl Area {
    /// Makes a rectangle from its middle and its sides, m.
    pub fn around(centre: Point, length_m: f64, width_m: f64) -> Self {
        let (half_length_m, half_width_m) = (0.5 * length_m, 0.5 * width_m);
        Self {
            min: Point::new(centre.x_m - half_length_m, centre.y_m - half_width_m),
            max: Point::new(centre.x_m + half_length_m, centre.y_m + half_width_m),
        }
    }

    /// Returns its four sides.
    pub fn sides(&self) -> [Segment; 4] {
        let corners = [
            self.min,
            Point::new(self.max.x_m, self.min.y_m),
            self.max,
            Point::new(self.min.x_m, self.max.y_m),
        ];
        let [a, b, c, d] = corners;
        [(a, b), (b, c), (c, d), (d, a)].map(|(from, to)| Segment { from, to })
    }

    /// Returns its surface, m².
    pub fn surface_m2(&self) -> f64 {
        (self.max.x_m - self.min.x_m).max(0.0) * (self.max.y_m - self.min.y_m).max(0.0)
    }

    /// Returns the distance of a point from the rectangle, 0 inside, m.
    pub fn distance_m(&self, point: Point) -> f64 {
        let x_m = (self.min.x_m - point.x_m)
            .max(point.x_m - self.max.x_m)
            .max(0.0);
        let y_m = (self.min.y_m - point.y_m)
            .max(point.y_m - self.max.y_m)
            .max(0.0);
        x_m.hypot(y_m)
    }
}
