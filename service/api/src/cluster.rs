//! Route `GET /cluster`: the instances, their robots and duties, and their state.

use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use fleetcal_cluster::{Membership, Snapshot};
use fleetcal_documents::ClusterDocument;
use fleetcal_proto::RobotId;

use super::ApiState;
use super::extract::{NoParameters, Parameters};
use super::problem::Problem;

/// Owners of the robots at one moment.
#[derive(Debug)]
pub(super) struct Owners(Option<Arc<Snapshot>>);

impl Owners {
    /// Owners as this instance knows them now.
    pub(super) fn now(membership: &Membership) -> Self {
        Self(membership.cluster().map(|cluster| cluster.snapshot()))
    }

    /// Instance that estimates a robot; `None` while there is none, and for a single service.
    pub(super) fn of(&self, robot: &RobotId) -> Option<String> {
        let owner = self.0.as_ref()?.robots.get(robot)?.owner.as_ref()?;
        Some(owner.instance.as_str().to_owned())
    }
}

/// Returns the instances of the cluster as this one knows them: the state and number of robots of
/// each, the owner of each duty, and the robots without an instance.
///
/// For a single service that has all robots, `alone` is true and the list is empty.
#[utoipa::path(get, path = "/cluster", tag = "service",
    responses((status = OK, description = "The instances", body = ClusterDocument)))]
pub(super) async fn get_cluster(
    State(api): State<ApiState>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Result<Json<ClusterDocument>, Problem> {
    Ok(Json(ClusterDocument::of(&api.membership)))
}
