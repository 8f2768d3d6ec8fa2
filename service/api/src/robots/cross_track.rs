//! Route `GET /robots/{id}/cross_track_error`: the accuracy of a robot's path following, by
//! calibration.

use axum::Json;
use axum::extract::State;
use fleetcal_domain::robot::{BIN_WIDTH_M, BINS_PER_SIDE, CrossTrack};
use fleetcal_model::Generation;
use fleetcal_proto::RobotId;
use serde::Serialize;

use crate::ApiState;
use crate::extract::{NoParameters, Parameters, RobotPath};
use crate::problem::Problem;

/// Cross-track errors that a robot reported.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = CrossTrackErrors)]
pub(super) struct CrossTrackDocument {
    /// Width of a bin, m.
    bin_width_m: f64,
    /// Begin of the first bin, m; negative is right of the path. Errors beyond the bins count in
    /// the outermost ones.
    from_m: f64,
    /// List with one entry for each calibration that the robot has used, oldest first.
    items: Vec<CrossTrackItem>,
}

/// Errors with one calibration.
#[derive(Debug, Serialize, utoipa::ToSchema)]
struct CrossTrackItem {
    /// Generation of the calibration; 0 for the factory calibration.
    generation: Generation,
    /// Number of errors.
    count: u64,
    /// Root mean square of the errors, m.
    rms_m: f64,
    /// Mean of the errors, m; positive is left of the path.
    mean_m: f64,
    /// Number of errors in each bin.
    bins: Vec<u64>,
}

impl CrossTrackItem {
    fn of((generation, errors): (Generation, CrossTrack)) -> Self {
        Self {
            generation,
            count: errors.count,
            rms_m: errors.rms_m(),
            mean_m: errors.mean_m(),
            bins: errors.bins,
        }
    }
}

/// Returns a robot's cross-track errors with each calibration that it has used, if it reports them.
#[utoipa::path(
    get,
    path = "/robots/{id}/cross_track_error",
    tag = "robots",
    params(("id" = RobotId, Path, description = "The robot.")),
    responses(
        (status = OK, description = "The cross-track errors", body = CrossTrackDocument),
        (status = NOT_FOUND, description = "The robot is unknown"),
    )
)]
pub(super) async fn get_cross_track_error(
    State(api): State<ApiState>,
    RobotPath(id): RobotPath,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Result<Json<CrossTrackDocument>, Problem> {
    if api.fleet.robot(&id).is_none() {
        return Err(Problem::robot_unknown(id.as_str()));
    }
    let items = api.fleet.cross_tracks(&id).into_iter();
    Ok(Json(CrossTrackDocument {
        bin_width_m: BIN_WIDTH_M,
        from_m: -BIN_WIDTH_M * BINS_PER_SIDE as f64,
        items: items.map(CrossTrackItem::of).collect(),
    }))
}
