//! `GET /cluster`: the instances, what each has, and how they get on.

mod document;

use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use fleetcal_cluster::{Membership, Snapshot};
use fleetcal_proto::RobotId;

use super::ApiState;
use super::extract::{NoParameters, Parameters};
use super::problem::Problem;

use document::ClusterDocument;

/// Who estimates which robot, at one moment.
#[derive(Debug)]
pub(super) struct Owners(Option<Arc<Snapshot>>);

impl Owners {
    /// As this instance knows it now.
    pub(super) fn now(membership: &Membership) -> Self {
        Self(membership.cluster().map(|cluster| cluster.snapshot()))
    }

    /// The instance that estimates a robot; `None` while none does, and of a service that is alone.
    pub(super) fn of(&self, robot: &RobotId) -> Option<String> {
        let owner = self.0.as_ref()?.robots.get(robot)?.owner.as_ref()?;
        Some(owner.instance.as_str().to_owned())
    }
}

/// Gives the instances of the cluster as this one knows them: which robots each has and for how long,
/// who does what for all, and which robots nobody has. Of a service that has all robots, `alone` is
/// true and there are none.
#[utoipa::path(get, path = "/cluster", tag = "service",
    responses((status = OK, description = "The instances", body = ClusterDocument)))]
pub(super) async fn get_cluster(
    State(api): State<ApiState>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Result<Json<ClusterDocument>, Problem> {
    Ok(Json(ClusterDocument::of(&api.membership)))
}
