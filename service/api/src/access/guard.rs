//! Guard before every route: the table of permissions, and no cross-site requests.

use axum::body::Body;
use axum::extract::{MatchedPath, Request, State};
use axum::http::StatusCode;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use fleetcal_domain::access::Access;
use tower_http::csrf::{CsrfLayer, ProtectionError};

use super::caller::{Asked, authenticate};
use super::{table, writes};
use crate::ApiState;
use crate::problem::Problem;
use fleetcal_http::PublicUrl;

/// Passes a request to its route, with its [`super::Caller`], if the table of permissions admits
/// it.
pub(crate) async fn authorise(
    State(api): State<ApiState>,
    request: Request,
    next: Next,
) -> Response {
    match admitted(&api, request).await {
        Ok(request) => next.run(request).await,
        Err(problem) => problem.into_response(),
    }
}

async fn admitted(api: &ApiState, request: Request) -> Result<Request, Problem> {
    let (mut parts, body) = request.into_parts();
    let matched = parts.extensions.get::<MatchedPath>();
    let template = matched.map_or("", MatchedPath::as_str).to_owned();
    let access = table::access(&parts.method, &template).ok_or_else(|| {
        let detail = format!("nobody is permitted {} {template}", parts.method);
        Problem::new(StatusCode::FORBIDDEN, "not_permitted", detail)
    })?;
    if access != Access::Public {
        let robot = robot_of(&template, parts.uri.path()).map(str::to_owned);
        let caller = authenticate(api, &parts, Asked { access, robot }).await?;
        tracing::Span::current().record("actor", &*caller.actor.name);
        if !caller.route.permits(&caller.grant) {
            let role = caller.grant.role().as_str();
            let detail = format!("your role: got {role}, expected {}", access.accepted());
            return Err(Problem::new(StatusCode::FORBIDDEN, "not_permitted", detail));
        }
        if !parts.method.is_safe() {
            writes::count(api, &caller, 1)?;
        }
        parts.extensions.insert(caller);
    }
    Ok(Request::from_parts(parts, body))
}

/// Robot that a path names, in the path's spelling: any other spelling, such as with percent signs,
/// equals no robot's id.
fn robot_of<'a>(template: &str, path: &'a str) -> Option<&'a str> {
    let at = template
        .split('/')
        .collect::<Vec<_>>()
        .windows(2)
        .position(|pair| pair == ["robots", "{id}"])?;
    path.split('/').nth(at + 1)
}

/// Refuses requests that a page of another site makes a browser send, by `Sec-Fetch-Site` or
/// `Origin`. Requests that only read pass, and so do those of tools, which send neither header.
pub(crate) fn cross_origin_refused(
    public_url: Option<&PublicUrl>,
) -> CsrfLayer<impl FnMut(ProtectionError) -> Response<Body> + Clone + use<>> {
    let mut layer = CsrfLayer::new();
    if let Some(url) = public_url {
        layer = layer
            .clone()
            .add_trusted_origin(url.as_str())
            .unwrap_or_else(|error| {
                tracing::error!(%error, "public_url is no origin");
                layer
            });
    }
    layer.with_rejection_response(|_: ProtectionError| {
        let detail = "the request comes from a page of another site";
        Problem::new(StatusCode::FORBIDDEN, "cross_origin", detail).into_response()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_robot_is_taken_from_its_place_in_the_path() {
        let of = |template, path| robot_of(template, path);
        let template = "/api/v1/robots/{id}/calibration";
        assert_eq!(
            of(template, "/api/v1/robots/agv_1/calibration"),
            Some("agv_1")
        );
        assert_eq!(of(template, "/api/v1/robots/%61/calibration"), Some("%61"));
        assert_eq!(of("/api/v1/tokens/{id}", "/api/v1/tokens/7"), None);
        assert_eq!(of("/api/v1/robots", "/api/v1/robots"), None);
    }
}
