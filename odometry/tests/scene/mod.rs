//! A small world to drive a LiDAR through, with its truth: walls, walking people, a rolling scan.
#![expect(clippy::unwrap_used, reason = "a scene that cannot be ends its test")]

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use fleetcal_odometry::ScanShape;
use fleetcal_odometry::{Pose2, RobotTime, Scan};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use rand_distr::{Distribution, Normal};

/// First stamp of every run.
pub const START: RobotTime = RobotTime(1_790_000_000_000_000_000);

/// Height of the LiDAR above the floor, m.
const HEIGHT_M: f64 = 0.2;

/// A person: a disc that walks to and fro.
#[derive(Debug, Clone, Copy)]
pub struct Person {
    centre: [f64; 2],
    heading_rad: f64,
    reach_m: f64,
    speed_mps: f64,
    phase: f64,
}

impl Person {
    pub fn position(&self, t: f64) -> [f64; 2] {
        let swing = self.reach_m * (self.speed_mps / self.reach_m * t + self.phase).sin();
        let (s, c) = self.heading_rad.sin_cos();
        [self.centre[0] + swing * c, self.centre[1] + swing * s]
    }
}

/// Walls and people.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// Walls, from (x, y) to (x, y), m.
    pub walls: Vec<[f64; 4]>,
    /// Poles: x, y, radius, m.
    pub poles: Vec<[f64; 3]>,
    /// People.
    pub people: Vec<Person>,
}

impl Scene {
    /// A rectangle's four walls.
    pub fn add_box(&mut self, x0: f64, y0: f64, x1: f64, y1: f64) {
        self.walls.extend([
            [x0, y0, x1, y0],
            [x1, y0, x1, y1],
            [x1, y1, x0, y1],
            [x0, y1, x0, y0],
        ]);
    }

    /// A hall of 24 m by 16 m with shelves, pallets and poles around a free middle.
    pub fn warehouse() -> Self {
        let mut scene = Self::default();
        scene.add_box(-12.0, -8.0, 12.0, 8.0);
        for x in [-9.0, -5.5, -2.0, 1.5, 5.0] {
            scene.add_box(x, 5.0, x + 2.7, 6.1);
            scene.add_box(x + 0.4, -6.3, x + 3.0, -5.2);
        }
        scene.add_box(-10.5, -2.0, -9.6, 1.5);
        scene.add_box(9.4, -1.0, 10.6, 2.2);
        scene.walls.push([8.0, -5.0, 10.5, -3.2]);
        scene.poles = vec![
            [0.0, 3.2, 0.2],
            [-7.0, 3.5, 0.1],
            [7.5, 3.8, 0.15],
            [7.0, -4.0, 0.1],
        ];
        scene
    }

    /// A corridor 2.4 m wide along x whose ends are out of sight.
    pub fn corridor() -> Self {
        Self {
            walls: vec![[-200.0, -1.2, 200.0, -1.2], [-200.0, 1.2, 200.0, 1.2]],
            ..Self::default()
        }
    }

    /// Adds people who walk at 0.5 to 1.5 m/s anywhere within `half` metres of the middle.
    #[must_use]
    pub fn with_people(mut self, count: usize, half: [f64; 2], seed: u64) -> Self {
        let mut rng = StdRng::seed_from_u64(seed);
        for _ in 0..count {
            self.people.push(Person {
                centre: [
                    rng.random_range(-half[0]..half[0]),
                    rng.random_range(-half[1]..half[1]),
                ],
                heading_rad: rng.random_range(0.0..TAU),
                reach_m: rng.random_range(1.0..3.0),
                speed_mps: rng.random_range(0.5..1.5),
                phase: rng.random_range(0.0..TAU),
            });
        }
        self
    }

    /// Range of a beam, and the cosine of its incidence on what it hits.
    pub fn seen_from(&self, origin: [f64; 2], angle_rad: f64, people: &[[f64; 2]]) -> (f64, f64) {
        let (s, c) = angle_rad.sin_cos();
        let (mut nearest, mut cos) = (f64::INFINITY, 1.0);
        for [x0, y0, x1, y1] in &self.walls {
            let (ex, ey) = (x1 - x0, y1 - y0);
            let (ax, ay) = (x0 - origin[0], y0 - origin[1]);
            let determinant = ex * s - ey * c;
            let t = (ex * ay - ey * ax) / determinant;
            let u = (c * ay - s * ax) / determinant;
            if t > 0.0 && t < nearest && (0.0..=1.0).contains(&u) {
                nearest = t;
                cos = determinant.abs() / ex.hypot(ey);
            }
        }
        let poles = self.poles.iter().map(|[x, y, r]| ([*x, *y], *r));
        for (centre, radius) in poles.chain(people.iter().map(|centre| (*centre, 0.22))) {
            let (ax, ay) = (centre[0] - origin[0], centre[1] - origin[1]);
            let along = ax * c + ay * s;
            let across = ax * s - ay * c;
            // People step aside for a robot.
            if ax.hypot(ay) < radius + 0.3 {
                continue;
            }
            let half_chord = (radius * radius - across * across).max(0.0).sqrt();
            if along > 0.0 && across.abs() < radius && along - half_chord < nearest {
                nearest = along - half_chord;
                cos = half_chord / radius;
            }
        }
        (nearest, cos)
    }
}

/// Properties of the scanner.
#[derive(Debug, Clone, Copy)]
pub struct Scanner {
    pub beams: usize,
    pub fov_rad: f64,
    pub clockwise: bool,
    pub rolling: bool,
    pub period_s: f64,
    pub noise_m: f64,
    pub dropped: f64,
    pub range_max_m: f64,
    /// True if a rolling scanner does not publish the beams' times (`time_increment` 0).
    pub untimed: bool,
    /// Bias of every range, m.
    pub range_bias_m: f64,
    /// Bias of a range as the surface turns away from the beam, m: all of it at a grazing beam.
    pub incidence_bias_m: f64,
    /// Tilt of its plane, and the direction it is tilted towards, rad.
    pub tilt_rad: f64,
    pub tilt_direction_rad: f64,
    /// Unevenness of the floor, m.
    pub uneven_m: f64,
    /// Swing of the plane's tilt as the robot drives, rad.
    pub pitch_rad: f64,
}

impl Default for Scanner {
    fn default() -> Self {
        Self {
            beams: 1024,
            fov_rad: TAU,
            clockwise: false,
            rolling: true,
            period_s: 0.1,
            noise_m: 0.015,
            dropped: 0.0,
            range_max_m: 40.0,
            untimed: false,
            range_bias_m: 0.0,
            incidence_bias_m: 0.0,
            tilt_rad: 0.0,
            tilt_direction_rad: 0.0,
            uneven_m: 0.0,
            pitch_rad: 0.0,
        }
    }
}

impl Scanner {
    pub fn shape(&self) -> ScanShape {
        let sign = if self.clockwise { -1.0 } else { 1.0 };
        let increment = self.fov_rad / self.beams as f64;
        ScanShape {
            angle_min_rad: -sign * 0.5 * self.fov_rad,
            angle_increment_rad: sign * increment,
            // A narrower view takes its part of the turn.
            time_increment_s: if self.rolling {
                self.period_s * increment / TAU
            } else {
                0.0
            },
            range_min_m: 0.1,
            range_max_m: self.range_max_m,
        }
    }

    /// Range of a beam on the floor, and the cosine of its incidence there. `angle_rad` is that of
    /// the beam in the LiDAR's frame, `t` its time, s.
    fn on_floor(&self, pose: &Pose2, angle_rad: f64, t: f64) -> (f64, f64) {
        let tilt_rad = self.tilt_rad + self.pitch_rad * (2.1 * t).sin();
        let down = (angle_rad - self.tilt_direction_rad).cos() * tilt_rad.sin();
        if down <= 0.0 {
            return (f64::INFINITY, 1.0);
        }
        let level_m = HEIGHT_M / down;
        let (s, c) = (pose.yaw_rad + angle_rad).sin_cos();
        let (x, y) = (pose.x_m + level_m * c, pose.y_m + level_m * s);
        let height_m = HEIGHT_M - self.uneven_m * (1.3 * x).sin() * (1.7 * y).cos();
        (height_m / down, down)
    }

    /// The scan that begins `t` seconds after [`START`], and the LiDAR's true pose at its middle.
    pub fn scan(
        &self,
        scene: &Scene,
        route: &dyn Fn(f64) -> Pose2,
        t: f64,
        rng: &mut StdRng,
    ) -> (Scan, Pose2) {
        let shape = self.shape();
        let noise = Normal::new(0.0, self.noise_m).unwrap();
        let middle_s = 0.5 * (self.beams - 1) as f64 * shape.time_increment_s;
        let at_middle = route(t + middle_s);
        let ranges: Arc<[f32]> = (0..self.beams)
            .map(|beam| {
                let beam_t = t + beam as f64 * shape.time_increment_s;
                let pose = if self.rolling {
                    route(beam_t)
                } else {
                    at_middle
                };
                let people: Vec<_> = scene.people.iter().map(|p| p.position(beam_t)).collect();
                let own_rad = shape.angle_min_rad + beam as f64 * shape.angle_increment_rad;
                let origin = [pose.x_m, pose.y_m];
                let seen = scene.seen_from(origin, pose.yaw_rad + own_rad, &people);
                let floor = self.on_floor(&pose, own_rad, beam_t);
                let (range, cos) = if floor.0 < seen.0 { floor } else { seen };
                let bias_m = self.range_bias_m + self.incidence_bias_m * (1.0 - cos);
                let measured = range + bias_m + noise.sample(rng);
                let is_lost = range > self.range_max_m || rng.random_bool(self.dropped);
                if is_lost {
                    f32::INFINITY
                } else {
                    measured as f32
                }
            })
            .collect();
        let told = ScanShape {
            time_increment_s: if self.untimed {
                0.0
            } else {
                shape.time_increment_s
            },
            ..shape
        };
        (
            Scan::new(START.plus_seconds(t), told, ranges).unwrap(),
            at_middle,
        )
    }
}

/// A LiDAR 0.434 m ahead of the rear axle of a vehicle that drives figures of eight, 0.5 to 1.4 m/s,
/// from a standstill.
pub fn figure_eight(t: f64) -> Pose2 {
    let half_period_s = 17.0;
    // Phase with a smooth start.
    let s = if t < 4.0 { t * t / 8.0 } else { t - 2.0 };
    let w = PI / half_period_s;
    let (x, y) = (6.0 * (w * s).sin(), 2.8 * (2.0 * w * s).sin());
    let (dx, dy) = (6.0 * w * (w * s).cos(), 5.6 * w * (2.0 * w * s).cos());
    Pose2::new(x, y, dy.atan2(dx)).compose(&Pose2::new(0.434, -0.016, 0.013))
}

/// Straight on along x at 0.8 m/s from `x0`.
pub fn straight(x0: f64) -> impl Fn(f64) -> Pose2 {
    move |t| Pose2::new(x0 + 0.8 * t, 0.1, 0.02)
}

/// The generator of a run's noise.
pub fn seeded(seed: u64) -> StdRng {
    StdRng::seed_from_u64(seed)
}
