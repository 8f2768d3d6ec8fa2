//! Requests for data in the memory of the instance that estimates a robot: any instance accepts
//! them, and forwards them to that one.

use axum::body::Body;
use axum::extract::{FromRequestParts, MatchedPath, OriginalUri};
use axum::http::StatusCode;
use axum::http::request::Parts;
use axum::response::{IntoResponse, Response};
use fleetcal_cluster::{InstanceId, Whereabouts};
use fleetcal_domain::limits;
use fleetcal_http::{PeerAddress, WritePatience, is_forwarded};
use fleetcal_operations::peers::Forwarded;
use fleetcal_proto::RobotId;

use crate::ApiState;
use crate::extract::RobotPath;
use crate::problem::Problem;

/// Time that a client should wait for a robot to have an instance again, s.
const RETRY_AFTER_S: u32 = 1;

/// Robot that a path names, which this instance estimates. A request for another instance's robot
/// ends here, with that one's answer; one for a robot without an instance is refused.
pub(crate) struct OwnRobot(pub(crate) RobotId);

impl FromRequestParts<ApiState> for OwnRobot {
    type Rejection = Response;

    async fn from_request_parts(parts: &mut Parts, api: &ApiState) -> Result<Self, Response> {
        let RobotPath(id) = RobotPath::from_request_parts(parts, api)
            .await
            .map_err(IntoResponse::into_response)?;
        let member = match api.membership.whereabouts(&id) {
            Whereabouts::Here => return Ok(Self(id)),
            Whereabouts::At(member) => member,
            // Of a robot that is not registered there is nothing to own.
            Whereabouts::Nowhere if !is_registered(api, &id) => return Ok(Self(id)),
            Whereabouts::Nowhere => return Err(no_instance(&id).into_response()),
        };
        // One hop: who passed it on has read the rows a moment before or after this instance.
        if is_forwarded(&parts.headers) {
            return Err(no_instance(&id).into_response());
        }
        let answer = forwarded(api, parts, &member.seat.instance).await;
        Err(answer.unwrap_or_else(IntoResponse::into_response))
    }
}

fn is_registered(api: &ApiState, id: &RobotId) -> bool {
    let robot = api.fleet.robot(id);
    robot.is_some_and(|robot| robot.config.is_some())
}

fn no_instance(id: &RobotId) -> Problem {
    let detail = format!("no instance estimates robot {id} at this moment");
    Problem::new(StatusCode::SERVICE_UNAVAILABLE, "no_instance", detail).retry_after(RETRY_AFTER_S)
}

/// Answer of the instance `to`.
async fn forwarded(api: &ApiState, parts: &Parts, to: &InstanceId) -> Result<Response, Problem> {
    let PeerAddress(client) = parts.extensions.get().copied().unwrap_or(PeerAddress(None));
    // Of the request's own path a nested router has taken the beginning off.
    let uri = parts.extensions.get::<OriginalUri>();
    let target = uri.map_or(&parts.uri, |original| &original.0);
    let target = target.path_and_query();
    let request = Forwarded {
        method: &parts.method,
        target: target.map_or("/", |target| target.as_str()),
        headers: &parts.headers,
        client,
    };
    let answer = api.peers.forward(to, request).await.map_err(|error| {
        let instance = to.as_str();
        tracing::warn!(instance, %error, "another instance did not answer");
        let detail = format!("instance {instance}, which has the robot, did not answer: {error}");
        let status = StatusCode::SERVICE_UNAVAILABLE;
        Problem::new(status, "instance_unreachable", detail).retry_after(RETRY_AFTER_S)
    })?;
    let mut answer = answer.map(Body::new);
    let route = parts.extensions.get::<MatchedPath>();
    if route.is_some_and(|route| route.as_str().ends_with("/recording")) {
        let patience = WritePatience(limits::RECORDING_STALLED_AFTER);
        answer.extensions_mut().insert(patience);
    }
    Ok(answer)
}
