//! A 3D scanner in the small world.

use fleetcal_odometry::Pose2;
use fleetcal_odometry::point_cloud::{CloudPoint, PointCloud};
use rand::Rng;
use rand::rngs::StdRng;
use rand_distr::{Distribution, Normal};

use crate::scene::{START, Scanner, Scene};

/// A scanner of 32 rings from −16 to 15 degrees, half a metre above the floor of a hall 5 m high.
#[derive(Debug, Clone, Copy)]
pub struct RingScanner {
    /// Its columns, field of view, noise and the rest are those of a planar one.
    pub planar: Scanner,
}

/// Heights of the floor and the ceiling above the LiDAR, m.
const FLOOR_M: f64 = -0.5;
const CEILING_M: f64 = 4.5;

impl RingScanner {
    /// The cloud of the turn that begins `t` seconds after [`START`], and the LiDAR's true pose at
    /// its middle. Walls and people reach from the floor to the ceiling.
    pub fn cloud(
        &self,
        scene: &Scene,
        route: &dyn Fn(f64) -> Pose2,
        t: f64,
        rng: &mut StdRng,
    ) -> (PointCloud, Pose2) {
        let shape = self.planar.shape();
        let noise = Normal::new(0.0, self.planar.noise_m).unwrap();
        let middle_s = 0.5 * (self.planar.beams - 1) as f64 * shape.time_increment_s;
        let mut points = Vec::with_capacity(32 * self.planar.beams);
        for column in 0..self.planar.beams {
            let time_s = column as f64 * shape.time_increment_s;
            let pose = route(t + time_s);
            let people: Vec<_> = scene
                .people
                .iter()
                .map(|p| p.position(t + time_s))
                .collect();
            let azimuth = shape.angle_min_rad + column as f64 * shape.angle_increment_rad;
            let origin = [pose.x_m, pose.y_m];
            let (wall_m, _) = scene.seen_from(origin, pose.yaw_rad + azimuth, &people);
            for ring in 0..32 {
                let elevation = (f64::from(ring) - 16.0).to_radians();
                let slope = elevation.tan();
                let flat_m = if slope < 0.0 { FLOOR_M } else { CEILING_M } / slope;
                let range_m = wall_m.min(flat_m) / elevation.cos() + noise.sample(rng);
                let is_lost =
                    range_m > self.planar.range_max_m || rng.random_bool(self.planar.dropped);
                let range_m = if is_lost { f64::NAN } else { range_m };
                let level_m = range_m * elevation.cos();
                let position = [
                    level_m * azimuth.cos(),
                    level_m * azimuth.sin(),
                    level_m * slope,
                ];
                points.push(CloudPoint {
                    position_m: position.map(|metres| metres as f32),
                    time_s: time_s as f32,
                });
            }
        }
        let cloud = PointCloud {
            stamp: START.plus_seconds(t),
            points,
            columns: Some(self.planar.beams),
        };
        (cloud, route(t + middle_s))
    }
}
