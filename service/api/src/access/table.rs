//! Table of the permissions of every route. A route that it lacks is refused to every caller, and a
//! test compares it with the OpenAPI document.

use axum::http::Method;
use fleetcal_domain::access::Access::{
    self, Admin, Approver, Operator, OwnRobot, OwnRobotOrViewer, Public, Viewer,
};

/// Method, path in the router's form, and required permission.
pub(crate) const TABLE: &[(&str, &str, Access)] = &[
    ("GET", "/healthz", Public),
    ("GET", "/readyz", Public),
    ("GET", "/metrics", Public),
    ("GET", "/.well-known/security.txt", Public),
    ("POST", "/api/v1/setup", Public),
    ("POST", "/api/v1/session", Public),
    ("GET", "/api/v1/session", Viewer),
    ("DELETE", "/api/v1/session", Viewer),
    ("POST", "/api/v1/session/password", Viewer),
    ("GET", "/api/v1/tokens", Admin),
    ("POST", "/api/v1/tokens", Admin),
    ("DELETE", "/api/v1/tokens/{id}", Admin),
    ("GET", "/api/v1/users", Admin),
    ("POST", "/api/v1/users", Admin),
    ("GET", "/api/v1/users/{id}", Admin),
    ("PATCH", "/api/v1/users/{id}", Admin),
    ("DELETE", "/api/v1/users/{id}", Admin),
    ("GET", "/api/v1/signing-key", Public),
    ("GET", "/api/v1/proposals", Viewer),
    ("POST", "/api/v1/proposals", Operator),
    ("POST", "/api/v1/proposals/approve", Approver),
    ("GET", "/api/v1/proposals/{id}", Viewer),
    ("POST", "/api/v1/proposals/{id}/approve", Approver),
    ("POST", "/api/v1/proposals/{id}/reject", Approver),
    ("POST", "/api/v1/proposals/{id}/withdraw", Operator),
    ("GET", "/api/v1/policy", Viewer),
    ("PUT", "/api/v1/policy", Admin),
    ("GET", "/api/v1/deployments/freeze", Viewer),
    ("PUT", "/api/v1/deployments/freeze", Approver),
    ("GET", "/api/v1/rollouts", Viewer),
    ("POST", "/api/v1/rollouts", Approver),
    ("GET", "/api/v1/rollouts/{id}", Viewer),
    ("POST", "/api/v1/rollouts/{id}/pause", Approver),
    ("POST", "/api/v1/rollouts/{id}/resume", Approver),
    ("POST", "/api/v1/rollouts/{id}/halt", Approver),
    ("GET", "/api/v1/audit", Viewer),
    ("GET", "/api/v1/audit/head", Viewer),
    ("GET", "/api/v1/certificates", Viewer),
    ("GET", "/api/v1/certificates/{id}", Viewer),
    ("GET", "/api/v1/cluster", Viewer),
    ("GET", "/api/v1/alerts", Viewer),
    ("GET", "/api/v1/alerts/{id}", Viewer),
    ("POST", "/api/v1/alerts/{id}/ack", Operator),
    ("GET", "/api/v1/webhooks", Admin),
    ("POST", "/api/v1/webhooks", Admin),
    ("DELETE", "/api/v1/webhooks/{id}", Admin),
    ("GET", "/api/v1/webhooks/{id}/deliveries", Admin),
    ("GET", "/api/v1/openapi.json", Viewer),
    ("GET", "/api/v1/stream", Viewer),
    ("POST", "/api/v1/fleet/actions", Operator),
    ("POST", "/api/v1/fleet/import", Operator),
    ("GET", "/api/v1/fleet/retired", Viewer),
    ("GET", "/api/v1/fleet/statistics", Viewer),
    ("GET", "/api/v1/robots", Viewer),
    ("GET", "/api/v1/views/robots", Viewer),
    ("GET", "/api/v1/robots/{id}", Viewer),
    ("PUT", "/api/v1/robots/{id}", Operator),
    ("DELETE", "/api/v1/robots/{id}", Operator),
    ("POST", "/api/v1/robots/{id}/bring-back", Operator),
    ("GET", "/api/v1/robots/{id}/description", Viewer),
    ("POST", "/api/v1/robots/{id}/description", Operator),
    ("POST", "/api/v1/robots/{id}/preview", Operator),
    ("GET", "/api/v1/robots/{id}/estimate", Viewer),
    ("GET", "/api/v1/robots/{id}/history", Viewer),
    ("GET", "/api/v1/robots/{id}/cross_track_error", Viewer),
    ("GET", "/api/v1/robots/{id}/checks", Viewer),
    ("GET", "/api/v1/robots/{id}/innovations", Viewer),
    ("GET", "/api/v1/robots/{id}/manoeuvres", Viewer),
    ("GET", "/api/v1/robots/{id}/top-view", Viewer),
    ("GET", "/api/v1/robots/{id}/recording", Operator),
    ("GET", "/api/v1/robots/{id}/moments", Viewer),
    ("POST", "/api/v1/robots/{id}/moments", Operator),
    ("GET", "/api/v1/robots/{id}/moments/{moment}", Operator),
    ("GET", "/api/v1/robots/{id}/support", Operator),
    ("PUT", "/api/v1/robots/{id}/maintenance", Operator),
    ("GET", "/api/v1/robots/{id}/shadow", Viewer),
    ("GET", "/api/v1/robots/{id}/deployments", Viewer),
    ("POST", "/api/v1/robots/{id}/rollback", Approver),
    ("GET", "/api/v1/robots/{id}/calibration", OwnRobotOrViewer),
    ("PUT", "/api/v1/robots/{id}/calibration/applied", OwnRobot),
    ("GET", "/api/v1/robots/{id}/events", Viewer),
    ("POST", "/api/v1/robots/{id}/events", Operator),
];

/// Permission that a route requires; `None` for a route that the table lacks.
pub(crate) fn access(method: &Method, path: &str) -> Option<Access> {
    // The router answers HEAD with what GET does.
    let method = if *method == Method::HEAD {
        "GET"
    } else {
        method.as_str()
    };
    TABLE
        .iter()
        .find(|(of_method, of_path, _)| *of_method == method && *of_path == path)
        .map(|(_, _, access)| *access)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn head_is_get_and_the_rest_is_as_written() {
        assert_eq!(access(&Method::HEAD, "/healthz"), Some(Public));
        assert_eq!(access(&Method::PUT, "/api/v1/robots/{id}"), Some(Operator));
        assert_eq!(access(&Method::PUT, "/api/v1/robots/a"), None);
        assert_eq!(access(&Method::POST, "/healthz"), None);
    }
}
