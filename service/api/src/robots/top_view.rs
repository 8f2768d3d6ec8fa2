//! Route `GET /robots/{id}/top-view`: the top view of a robot.

use axum::Json;
use axum::extract::State;
use fleetcal_estimator::calibrator::{TopView, TrajectoryPoint};
use fleetcal_model::Pose2;
use fleetcal_proto::RobotId;
use serde::Serialize;

use crate::ApiState;
use crate::extract::{NoParameters, Parameters};
use crate::forwarding::OwnRobot;
use crate::problem::Problem;

/// Top view of a robot: its latest scan on the local map, and its trajectory by the LiDAR and by
/// raw and corrected steering. All in the LiDAR's odometry frame.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = TopView)]
pub(super) struct TopViewDocument {
    /// Time of the latest scan or pose, ns since 1970 by the robot's clock.
    stamp_ns: i64,
    /// Pose of the LiDAR at that time.
    lidar: TopViewPose,
    /// Estimated pose of the LiDAR from the rear axle's centre; null before the first guess.
    lidar_in_base: Option<TopViewPose>,
    /// True if the scan fits nowhere on the map: its pose is a guess.
    lost: bool,
    /// Returns of the latest scan, corrected for the motion within it: x and y, m. Empty for a
    /// robot that sends poses.
    returns_m: Vec<[f64; 2]>,
    /// Surfaces of the local map, a point for each cell of 10 cm, the nearest 4096 within 30 m: x
    /// and y, m. Empty for a robot that sends poses.
    surfaces_m: Vec<[f64; 2]>,
    /// Trajectory of the rear axle, oldest first: the last 20 m, or the latest stretch without a
    /// gap. Empty before the first guess.
    trajectory: Vec<TopViewPoint>,
    /// Length of the trajectory by the wheels, m.
    distance_m: f64,
}

/// Pose in the plane.
#[derive(Debug, Serialize, utoipa::ToSchema)]
struct TopViewPose {
    /// Position x, m.
    x_m: f64,
    /// Position y, m.
    y_m: f64,
    /// Heading, counter-clockwise, rad.
    yaw_rad: f64,
}

/// Positions of the rear axle's centre at one time: x and y, m. The two by steering begin at the
/// LiDAR's pose, and follow speed and steering alone from there.
#[derive(Debug, Serialize, utoipa::ToSchema)]
struct TopViewPoint {
    /// Time of the position, ns since 1970 by the robot's clock.
    stamp_ns: i64,
    /// Position by LiDAR odometry and the estimated mount.
    by_lidar_m: [f64; 2],
    /// Position by the measured steering.
    by_raw_steering_m: [f64; 2],
    /// Position by the steering minus the estimated offset.
    by_corrected_steering_m: [f64; 2],
}

impl TopViewPose {
    fn of(pose: Pose2) -> Self {
        let Pose2 { x_m, y_m, yaw_rad } = pose.wrapped();
        let [x_m, y_m] = rounded([x_m, y_m]);
        Self {
            x_m,
            y_m,
            yaw_rad: (yaw_rad * 1e4).round() / 1e4,
        }
    }
}

impl TopViewPoint {
    fn of(point: &TrajectoryPoint) -> Self {
        let at = |pose: Pose2| rounded([pose.x_m, pose.y_m]);
        Self {
            stamp_ns: point.stamp.0,
            by_lidar_m: at(point.by_lidar),
            by_raw_steering_m: at(point.by_raw_steering),
            by_corrected_steering_m: at(point.by_corrected_steering),
        }
    }
}

impl TopViewDocument {
    pub(super) fn of(view: &TopView) -> Self {
        let seen = view.surroundings.as_ref();
        let all = |points: &[[f64; 2]]| points.iter().copied().map(rounded).collect();
        Self {
            stamp_ns: view.stamp.0,
            lidar: TopViewPose::of(view.lidar_in_odom),
            lidar_in_base: view.lidar_in_base.map(TopViewPose::of),
            lost: seen.is_some_and(|seen| seen.is_lost),
            returns_m: seen.map_or_else(Vec::new, |seen| all(&seen.returns_m)),
            surfaces_m: seen.map_or_else(Vec::new, |seen| all(&seen.surfaces_m)),
            trajectory: view.trajectory.iter().map(TopViewPoint::of).collect(),
            distance_m: view.distance_m,
        }
    }
}

/// Rounds to the millimetre: a drawing shows no more, and the answer is half as long.
fn rounded(point: [f64; 2]) -> [f64; 2] {
    point.map(|m| (m * 1e3).round() / 1e3)
}

/// Returns the top view of a robot from its estimator now; null before the first scan or pose.
#[utoipa::path(
    get,
    path = "/robots/{id}/top-view",
    tag = "robots",
    params(("id" = RobotId, Path, description = "The robot.")),
    responses(
        (status = OK, description = "The top view; null before the robot's first scan or pose",
            body = Option<TopViewDocument>),
        (status = NOT_FOUND, description = "The robot is unknown"),
        (status = CONFLICT, description = "The robot is not registered"),
        (status = SERVICE_UNAVAILABLE,
            description = "Too many requests for this view, no instance has the robot, or the request \
                took too long"),
    )
)]
pub(super) async fn get_top_view(
    State(api): State<ApiState>,
    OwnRobot(id): OwnRobot,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Result<Json<Option<TopViewDocument>>, Problem> {
    let view = api.fleet.top_view(&id).await?;
    Ok(Json(view.as_deref().map(TopViewDocument::of)))
}
