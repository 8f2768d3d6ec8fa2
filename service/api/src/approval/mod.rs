//! Proposals, deployments, shadows, the deployment freeze, and the audit.

mod audit;
mod calibration;
mod deployments;
mod freeze;
mod policy;
mod proposals;
mod several;

use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::ApiState;

pub(super) use fleetcal_documents::CalibrationSummary;
pub(super) use proposals::{
    NewProposalDocument, ReasonBody, close, propose, required_key, robot_named, robot_of,
};

pub(crate) use deployments::shadow_of;

/// Routes of the life cycle.
pub(super) fn routes() -> OpenApiRouter<ApiState> {
    OpenApiRouter::new()
        .routes(routes!(proposals::list_proposals, proposals::post_proposal))
        .routes(routes!(several::approve_several))
        .routes(routes!(proposals::get_proposal))
        .routes(routes!(proposals::approve_proposal))
        .routes(routes!(proposals::reject_proposal))
        .routes(routes!(proposals::withdraw_proposal))
        .routes(routes!(deployments::list_deployments))
        .routes(routes!(deployments::get_shadow))
        .routes(routes!(deployments::roll_back))
        .routes(routes!(calibration::get_calibration))
        .routes(routes!(calibration::put_applied))
        .routes(routes!(calibration::get_signing_key))
        .routes(routes!(policy::get_policy, policy::put_policy))
        .routes(routes!(freeze::get_freeze, freeze::put_freeze))
        .routes(routes!(audit::list_audit))
        .routes(routes!(audit::get_audit_head))
}
