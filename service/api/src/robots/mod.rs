//! Routes of robots: list, registration, estimate, history and events.

mod checks;
mod connection;
mod cross_track;
mod description;
mod document;
mod estimate;
mod events;
mod history;
mod innovations;
mod list;
mod manoeuvres;
mod moments;
mod preview;
mod recording;
mod registration;
mod retirement;
mod statistics;
mod support;
mod top_view;
mod view;

use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::ApiState;

pub(super) use connection::{MaintenanceBody, connection_state, maintain};
pub(super) use document::RobotStateDocument;
pub(super) use events::EventDocument;
pub(super) use recording::Recordings;
pub(super) use registration::{Prefixes, check_config, prefixes};
pub(super) use retirement::{bring_back, retire};
pub(super) use view::{in_view, query_of};

/// Routes under `/robots`.
pub(super) fn routes() -> OpenApiRouter<ApiState> {
    OpenApiRouter::new()
        .routes(routes!(list::list_robots))
        .routes(routes!(view::get_view))
        .routes(routes!(statistics::get_statistics))
        .routes(routes!(
            registration::get_robot,
            registration::put_robot,
            retirement::delete_robot
        ))
        .routes(routes!(
            description::get_description,
            description::take_description
        ))
        .routes(routes!(preview::preview_robot))
        .routes(routes!(estimate::get_estimate))
        .routes(routes!(history::get_history))
        .routes(routes!(innovations::get_innovations))
        .routes(routes!(cross_track::get_cross_track_error))
        .routes(routes!(checks::get_checks))
        .routes(routes!(manoeuvres::get_manoeuvres))
        .routes(routes!(top_view::get_top_view))
        .routes(routes!(recording::get_recording))
        .routes(routes!(moments::list_moments, moments::keep_moment))
        .routes(routes!(moments::get_moment))
        .routes(routes!(support::get_support))
        .routes(routes!(connection::put_maintenance))
        .routes(routes!(retirement::bring_robot_back))
        .routes(routes!(retirement::list_retired))
        .routes(routes!(events::list_events, events::post_event))
}
