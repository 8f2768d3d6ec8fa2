//! Route `GET /robots/{id}/manoeuvres`: the manoeuvres that a robot should drive next.

use axum::Json;
use axum::extract::State;
use fleetcal_estimator::advice::ranking::{Floor, Ranked};
use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::{Parameter, Vehicle};
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
#[derive(Debug, Default, Serialize, utoipa::ToSchema)]
#[schema(as = Manoeuvres)]
pub(super) struct ManoeuvresDocument {
    /// Manoeuvres that fit on the floor; empty before the robot has sent data.
    items: Vec<ManoeuvreDocument>,
    /// Sigmas at which the parameters of the robot are `converged`; absent before its configuration.
    #[serde(skip_serializing_if = "Option::is_none")]
    sigma_limits: Option<ParameterSigmas>,
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
    /// Time that it takes, s.
    duration_s: f64,
    /// Path of the rear axle, a point at least every 0.5 m: x and y, m. It begins at the origin,
    /// heading along x.
    path_m: Vec<[f64; 2]>,
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
    sigma_after: ParameterSigmas,
}

/// Sigmas of the four parameters of a calibration.
#[derive(Debug, Serialize, utoipa::ToSchema)]
struct ParameterSigmas {
    /// Sigma of the steering offset, rad.
    steering_offset: f64,
    /// Sigma of the LiDAR's x, m.
    lidar_x: f64,
    /// Sigma of the LiDAR's y, m.
    lidar_y: f64,
    /// Sigma of the LiDAR's yaw, rad.
    lidar_yaw: f64,
}

impl ParameterSigmas {
    fn of(sigma: impl Fn(Parameter) -> f64) -> Self {
        Self {
            steering_offset: sigma(Parameter::SteeringOffset),
            lidar_x: sigma(Parameter::LidarX),
            lidar_y: sigma(Parameter::LidarY),
            lidar_yaw: sigma(Parameter::LidarYaw),
        }
    }
}

impl ManoeuvreDocument {
    fn of(ranked: &Ranked, vehicle: &Vehicle) -> Self {
        let manoeuvre = &ranked.advice.manoeuvre;
        let path = manoeuvre.path(vehicle);
        let [length_m, width_m] = manoeuvre.space_m;
        let sigma = |parameter: Parameter| ranked.advice.sigma_after[parameter.index()];
        Self {
            name: manoeuvre.name,
            instruction: manoeuvre.instruction.clone(),
            distance_m: manoeuvre.distance_m(),
            duration_s: manoeuvre.duration_s(vehicle),
            path_m: path
                .iter()
                .map(|pose| [rounded_m(pose.x_m), rounded_m(pose.y_m)])
                .collect(),
            length_m,
            width_m,
            uncertainty_taken: ranked.uncertainty_taken,
            information_bits: ranked.information_bits,
            sigma_after: ParameterSigmas::of(sigma),
        }
    }
}

/// Rounds to the millimetre, as drawings do.
fn rounded_m(m: f64) -> f64 {
    (m * 1e3).round() / 1e3
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
    let robot = api
        .fleet
        .robot(&id)
        .ok_or_else(|| Problem::robot_unknown(id.as_str()))?;
    // Nothing is ranked for a robot without a configuration.
    let Some(config) = robot.config else {
        return Ok(Json(ManoeuvresDocument::default()));
    };
    let CalibratorConfig {
        vehicle, settings, ..
    } = config.calibrator_config(api.fleet.estimator());
    let limit = |parameter| *settings.converged_sigma.get(parameter);
    let ranked = api.fleet.manoeuvres(&id);
    let fits = |one: &&Ranked| floor.is_none_or(|floor| floor.fits(&one.advice.manoeuvre));
    let items = ranked.iter().filter(fits);
    Ok(Json(ManoeuvresDocument {
        items: items
            .map(|one| ManoeuvreDocument::of(one, &vehicle))
            .collect(),
        sigma_limits: Some(ParameterSigmas::of(limit)),
    }))
}
