//! Route `GET /robots/{id}/manoeuvres`: the manoeuvres that a robot should drive next.

use axum::Json;
use axum::extract::State;
use fleetcal_estimator::Parameter;
use fleetcal_estimator::advice::ranking::{Floor, Ranked};
use fleetcal_proto::RobotId;
use serde::{Deserialize, Serialize};

use crate::ApiState;
use crate::extract::Parameters;
use crate::forwarding::OwnRobot;
use crate::problem::Problem;

/// Largest side of a floor, m.
const SIDE_MAX_M: f64 = 10_000.0;

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct FloorParameters {
    /// Length of the free floor, m; without both sides every manoeuvre fits.
    #[param(value_type = Option<f64>)]
    length_m: Option<String>,
    /// Width of the free floor, m.
    #[param(value_type = Option<f64>)]
    width_m: Option<String>,
}

impl FloorParameters {
    fn floor(&self) -> Result<Option<Floor>, Problem> {
        let (Some(length), Some(width)) = (&self.length_m, &self.width_m) else {
            return match (&self.length_m, &self.width_m) {
                (None, None) => Ok(None),
                (None, _) => Err(refused("length_m", "nothing")),
                (_, _) => Err(refused("width_m", "nothing")),
            };
        };
        Ok(Some(Floor {
            length_m: side("length_m", length)?,
            width_m: side("width_m", width)?,
        }))
    }
}

fn side(name: &str, text: &str) -> Result<f64, Problem> {
    let side_m: Option<f64> = text.parse().ok();
    side_m
        .filter(|side_m| *side_m > 0.0 && *side_m <= SIDE_MAX_M)
        .ok_or_else(|| refused(name, text))
}

fn refused(name: &str, given: &str) -> Problem {
    let accepted = "both sides of the floor, each more than 0 and at most 10000 m";
    Problem::refused(name, given, accepted)
}

/// Manoeuvres that a robot should drive next, the best first.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Manoeuvres)]
pub(super) struct ManoeuvresDocument {
    /// Manoeuvres that fit on the floor; empty before the robot has sent data.
    items: Vec<ManoeuvreDocument>,
}

/// Manoeuvre with its benefit for this robot now.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Manoeuvre)]
struct ManoeuvreDocument {
    /// Short name, such as `left_turn`.
    name: &'static str,
    /// Instruction for a driver.
    instruction: String,
    /// Length of its path, m.
    distance_m: f64,
    /// Length of the floor that it needs, m.
    length_m: f64,
    /// Width of the floor that it needs, m.
    width_m: f64,
    /// Reduction of the sigmas that are too large for `converged`, in all, as a natural logarithm
    /// of the ratio; 0 if none is too large.
    uncertainty_taken: f64,
    /// Information about all estimated parameters, bits.
    information_bits: f64,
    /// Sigmas afterwards.
    sigma_after: SigmaAfter,
}

#[derive(Debug, Serialize, utoipa::ToSchema)]
struct SigmaAfter {
    /// Sigma of the steering offset, rad.
    steering_offset: f64,
    /// Sigma of the LiDAR's x, m.
    lidar_x: f64,
    /// Sigma of the LiDAR's y, m.
    lidar_y: f64,
    /// Sigma of the LiDAR's yaw, rad.
    lidar_yaw: f64,
}

impl ManoeuvreDocument {
    fn of(ranked: &Ranked) -> Self {
        let manoeuvre = &ranked.advice.manoeuvre;
        let [length_m, width_m] = manoeuvre.space_m;
        let sigma = |parameter: Parameter| ranked.advice.sigma_after[parameter.index()];
        Self {
            name: manoeuvre.name,
            instruction: manoeuvre.instruction.clone(),
            distance_m: manoeuvre.distance_m(),
            length_m,
            width_m,
            uncertainty_taken: ranked.uncertainty_taken,
            information_bits: ranked.information_bits,
            sigma_after: SigmaAfter {
                steering_offset: sigma(Parameter::SteeringOffset),
                lidar_x: sigma(Parameter::LidarX),
                lidar_y: sigma(Parameter::LidarY),
                lidar_yaw: sigma(Parameter::LidarYaw),
            },
        }
    }
}

/// Returns the manoeuvres that a robot should drive next: those that fit on the floor, by the
/// uncertainty that each removes per metre of its path.
#[utoipa::path(
    get,
    path = "/robots/{id}/manoeuvres",
    tag = "robots",
    params(("id" = RobotId, Path, description = "The robot."), FloorParameters),
    responses(
        (status = OK, description = "The manoeuvres, the best first", body = ManoeuvresDocument),
        (status = NOT_FOUND, description = "The robot is unknown"),
    )
)]
pub(super) async fn get_manoeuvres(
    State(api): State<ApiState>,
    OwnRobot(id): OwnRobot,
    Parameters(parameters): Parameters<FloorParameters>,
) -> Result<Json<ManoeuvresDocument>, Problem> {
    let floor = parameters.floor()?;
    if api.fleet.robot(&id).is_none() {
        return Err(Problem::robot_unknown(id.as_str()));
    }
    let ranked = api.fleet.manoeuvres(&id);
    let fits = |one: &&Ranked| floor.is_none_or(|floor| floor.fits(&one.advice.manoeuvre));
    let items = ranked.iter().filter(fits).map(ManoeuvreDocument::of);
    Ok(Json(ManoeuvresDocument {
        items: items.collect(),
    }))
}
