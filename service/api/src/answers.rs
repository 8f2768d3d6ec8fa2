//! Responses that operations share: refusals by the layers before a handler, and failures of the
//! service. A handler describes its own responses; [`complete`] adds these.

use std::collections::BTreeMap;

use axum::http::{Method, StatusCode};
use fleetcal_domain::access::Access;
use utoipa::openapi::header::HeaderBuilder;
use utoipa::openapi::path::{Operation, PathItem};
use utoipa::openapi::response::Response;
use utoipa::openapi::schema::{Object, Type};
use utoipa::openapi::{Content, OpenApi, Ref, RefOr, Required};

use super::{access, health};

/// Response that several operations share.
struct Shared {
    status: StatusCode,
    /// Name among the document's components.
    name: &'static str,
    description: String,
}

impl Shared {
    fn new(status: StatusCode, name: &'static str, description: impl Into<String>) -> Self {
        Self {
            status,
            name,
            description: description.into(),
        }
    }
}

/// Adds to each operation the responses that it can have and does not describe itself, adds each
/// error's [`super::problem::Problem`], and frees public operations of credentials.
pub(super) fn complete(document: &mut OpenApi) {
    let mut responses = BTreeMap::new();
    for (path, item) in &mut document.paths.paths {
        for (method, operation) in operations(item) {
            let access = access::of_route(&method, path);
            if access == Some(Access::Public) {
                operation.security = Some(Vec::new());
            }
            describe_problems(operation);
            for shared in shared(&method, path, access, operation) {
                let own = &mut operation.responses.responses;
                own.entry(shared.status.as_str().to_owned())
                    .or_insert_with(|| Ref::from_response_name(shared.name).into());
                let mut response = Response::new(shared.description);
                describe_problem(shared.status, &mut response);
                responses.insert(shared.name.to_owned(), response.into());
            }
        }
    }
    document.components.get_or_insert_default().responses = responses;
}

fn operations(item: &mut PathItem) -> impl Iterator<Item = (Method, &mut Operation)> {
    [
        (Method::GET, item.get.as_mut()),
        (Method::PUT, item.put.as_mut()),
        (Method::POST, item.post.as_mut()),
        (Method::DELETE, item.delete.as_mut()),
        (Method::PATCH, item.patch.as_mut()),
    ]
    .into_iter()
    .filter_map(|(method, operation)| Some((method, operation?)))
}

/// Shared responses of an operation.
fn shared(
    method: &Method,
    path: &str,
    access: Option<Access>,
    operation: &Operation,
) -> Vec<Shared> {
    let mut found = of_every_operation(path);
    found.extend(of_access(method, access));
    if operation.request_body.is_some() {
        found.extend(of_bodies());
    }
    let has_version = required(operation, "If-Match").is_some();
    if has_version {
        let stale = "The record has changed since the version in `If-Match`";
        let conflict = Shared::new(StatusCode::PRECONDITION_FAILED, "VersionConflict", stale);
        found.push(conflict);
    }
    if has_version || required(operation, "Idempotency-Key") == Some(true) {
        let missing = "The required `If-Match` or `Idempotency-Key` is missing";
        let missing = Shared::new(StatusCode::PRECONDITION_REQUIRED, "HeaderMissing", missing);
        found.push(missing);
    }
    found
}

fn of_every_operation(path: &str) -> Vec<Shared> {
    let refused = "A parameter is refused, which `field` names, or the body is not JSON";
    let large = "The header exceeds its limit";
    let large_status = StatusCode::REQUEST_HEADER_FIELDS_TOO_LARGE;
    let failed = "The service failed; its log has the details";
    let unavailable = "The database is unavailable, or the request took too long";
    let mut found = vec![
        Shared::new(StatusCode::BAD_REQUEST, "ValueRefused", refused),
        Shared::new(large_status, "HeaderTooLarge", large),
        Shared::new(StatusCode::INTERNAL_SERVER_ERROR, "Failed", failed),
        Shared::new(StatusCode::SERVICE_UNAVAILABLE, "Unavailable", unavailable),
    ];
    if !health::is_probe(path) {
        let many = "Too many requests from the client's address are under way, or the user or token \
            has changed too much";
        let many = Shared::new(StatusCode::TOO_MANY_REQUESTS, "TooManyRequests", many);
        found.push(many);
    }
    if path.starts_with("/api/") {
        let foreign = "The request is for another host";
        let foreign = Shared::new(StatusCode::MISDIRECTED_REQUEST, "HostRefused", foreign);
        found.push(foreign);
    }
    found
}

fn of_access(method: &Method, access: Option<Access>) -> Vec<Shared> {
    match access {
        Some(Access::Public) if *method != Method::GET => {
            let foreign = "A page of another site sent the request";
            vec![Shared::new(StatusCode::FORBIDDEN, "CrossOrigin", foreign)]
        }
        None | Some(Access::Public) => Vec::new(),
        Some(access) => {
            let missing = "There is no valid credential; `code` has the reason";
            let accepted = access.accepted();
            let accepted = format!("The caller is not permitted; expected {accepted}");
            vec![
                Shared::new(StatusCode::UNAUTHORIZED, "CredentialRefused", missing),
                Shared::new(StatusCode::FORBIDDEN, forbidden(access), accepted),
            ]
        }
    }
}

fn of_bodies() -> [Shared; 3] {
    let large = "The body exceeds its limit";
    let media = "The body is not sent as `application/json`";
    let unfit = "The body does not fit, or its `Idempotency-Key` came with another request";
    [
        Shared::new(StatusCode::PAYLOAD_TOO_LARGE, "BodyTooLarge", large),
        Shared::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "NotJson", media),
        Shared::new(StatusCode::UNPROCESSABLE_ENTITY, "BodyRefused", unfit),
    ]
}

/// Name of the refusal of callers that a route does not admit.
const fn forbidden(access: Access) -> &'static str {
    match access {
        Access::Public => "CrossOrigin",
        Access::Viewer => "ViewerNeeded",
        Access::Operator => "OperatorNeeded",
        Access::Approver => "ApproverNeeded",
        Access::Admin => "AdministratorNeeded",
        Access::OwnRobot => "OwnRobotNeeded",
        Access::OwnRobotOrViewer => "OwnRobotOrViewerNeeded",
    }
}

/// True if a parameter is required; `None` if the operation has no parameter of this name.
fn required(operation: &Operation, name: &str) -> Option<bool> {
    let parameters = operation.parameters.iter().flatten();
    parameters
        .filter_map(|parameter| match parameter {
            RefOr::T(parameter) => Some(parameter),
            RefOr::Ref(_) => None,
        })
        .find(|parameter| parameter.name == name)
        .map(|parameter| parameter.required == Required::True)
}

/// Adds the content of an operation's own errors.
fn describe_problems(operation: &mut Operation) {
    for (status, response) in &mut operation.responses.responses {
        if let (Ok(status), RefOr::T(response)) = (status.parse(), response) {
            describe_problem(status, response);
        }
    }
}

/// Adds content and headers to an error; leaves other responses unchanged.
fn describe_problem(status: StatusCode, response: &mut Response) {
    if status.as_u16() < 400 {
        return;
    }
    if response.content.is_empty() {
        let problem = Content::new(Some(Ref::from_schema_name("Problem")));
        let media = "application/problem+json".to_owned();
        response.content.insert(media, problem.into());
    }
    let header = match status {
        StatusCode::UNAUTHORIZED => ("WWW-Authenticate", Type::String, "`Bearer`."),
        StatusCode::TOO_MANY_REQUESTS | StatusCode::SERVICE_UNAVAILABLE => {
            let wait = "Seconds to wait before the next request.";
            ("Retry-After", Type::Integer, wait)
        }
        _ => return,
    };
    let (name, kind, description) = header;
    let described = HeaderBuilder::new()
        .schema(Some(Object::with_type(kind)))
        .description(Some(description))
        .build();
    response.headers.insert(name.to_owned(), described.into());
}
