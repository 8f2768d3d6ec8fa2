//! Picture of the LiDAR odometry for people: the latest scan on the local map.

use super::LidarOdometry;
use super::local_motion::LocalMotion;
use super::submap::{CELL_M, Cell, LocalOrigin, Submap};
use crate::RobotTime;
use crate::geometry::Pose2;

/// The latest scan and the map around it, in the odometry frame, m.
#[derive(Debug, Clone, PartialEq)]
pub struct Surroundings {
    /// The scan's reference time.
    pub stamp: RobotTime,
    /// The LiDAR's pose then.
    pub lidar_in_odom: Pose2,
    /// True if the scan fits nowhere: its pose is a guess.
    pub is_lost: bool,
    /// Its usable returns, corrected for the motion within the scan.
    pub returns_m: Vec<[f64; 2]>,
    /// Surfaces of the map, a point for each cell of 10 cm, the nearest first.
    pub surfaces_m: Vec<[f64; 2]>,
}

impl LidarOdometry {
    /// The latest scan, and at most `surfaces_max` points of surfaces at most `reach_m` from the
    /// LiDAR; `None` before the first scan.
    pub fn surroundings(&self, reach_m: f64, surfaces_max: usize) -> Option<Surroundings> {
        let motion = self.motion.as_ref()?;
        let pose = motion.pose;
        let origin = LocalOrigin::near(pose.x_m, pose.y_m);
        let (ox, oy) = origin.position_m();
        let local = LocalMotion::new(motion, origin);
        let returns = self.points.iter().map(|point| {
            let (qx, qy) = local.deskew(point.x, point.y, point.tau_s);
            let (x, y) = local.transform(qx, qy);
            [ox + f64::from(x), oy + f64::from(y)]
        });
        Some(Surroundings {
            stamp: self.last_stamp?,
            lidar_in_odom: pose.wrapped(),
            is_lost: self.track.is_lost(),
            returns_m: returns.collect(),
            surfaces_m: surfaces(&self.map.submap, pose, reach_m, surfaces_max),
        })
    }
}

fn surfaces(map: &Submap, around: Pose2, reach_m: f64, max: usize) -> Vec<[f64; 2]> {
    let origin = LocalOrigin::near(around.x_m, around.y_m);
    let (ox, oy) = origin.position_m();
    let (centre, _, _) = origin.locate((around.x_m - ox) as f32, (around.y_m - oy) as f32);
    let reach = (reach_m / CELL_M).ceil() as i32;
    let mut found: Vec<(f64, [f64; 2])> = Vec::new();
    map.for_each_occupied(centre, reach, |cell| {
        let point = surface_point(map, cell);
        let distance_m = (point[0] - around.x_m).hypot(point[1] - around.y_m);
        if distance_m <= reach_m {
            found.push((distance_m, point));
        }
    });
    found.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    found.truncate(max);
    found.into_iter().map(|(_, point)| point).collect()
}

/// The middle of a cell, moved onto its line where it has one that passes close by.
fn surface_point(map: &Submap, cell: Cell) -> [f64; 2] {
    let middle = [cell.x, cell.y].map(|at| (f64::from(at) + 0.5) * CELL_M);
    let line = map.line(cell);
    if !line.exists() || f64::from(line.d.abs()) > CELL_M {
        return middle;
    }
    let [x, y] = middle;
    [
        x + f64::from(line.d * line.nx),
        y + f64::from(line.d * line.ny),
    ]
}
