//! Every route of the description with every kind of credential. A new route is tested as soon as
//! it is described.

use std::collections::BTreeSet;

use fleetcal_domain::access::Access;
use fleetcal_model::WallTime;

use super::*;
use crate::access::TABLE;
use crate::openapi;

/// Every method and path of the description.
fn described() -> BTreeSet<(String, String)> {
    let document = serde_json::to_value(openapi()).unwrap();
    let paths = document["paths"].as_object().unwrap();
    let of_path = |(path, item): (&String, &Value)| {
        let methods: Vec<_> = item.as_object().unwrap().keys().cloned().collect();
        let path = path.clone();
        methods
            .into_iter()
            .map(move |method| (method.to_uppercase(), path.clone()))
    };
    paths.iter().flat_map(of_path).collect()
}

#[test]
fn every_route_has_its_row_and_every_row_its_route() {
    let rows = TABLE.iter();
    let rows: BTreeSet<_> = rows
        .map(|(method, path, _)| ((*method).to_owned(), (*path).to_owned()))
        .collect();
    assert_eq!(rows.len(), TABLE.len(), "a route has two rows");
    assert_eq!(rows, described());
}

#[test]
fn nothing_of_the_fleet_is_read_or_changed_by_nobody() {
    let public: BTreeSet<_> = TABLE
        .iter()
        .filter(|(_, path, access)| *access == Access::Public && path.starts_with("/api/"))
        .map(|(method, path, _)| (*method, *path))
        .collect();
    let known = [
        ("GET", "/api/v1/signing-key"),
        ("POST", "/api/v1/session"),
        ("POST", "/api/v1/setup"),
    ];
    for row in public {
        assert!(known.contains(&row), "{row:?} must not be public");
    }
}

/// Attempt to call a route, and the role that it should have.
struct Attempt {
    name: String,
    headers: Vec<(&'static str, String)>,
    grant: Option<Grant>,
}

impl Attempt {
    fn bearer(name: &str, token: &str, grant: Option<Grant>) -> Self {
        Self {
            name: name.to_owned(),
            headers: vec![("authorization", format!("Bearer {token}"))],
            grant,
        }
    }
}

/// Attempts without a credential, with garbage, with ended ones, and with one of each role, by
/// token and by session.
async fn attempts(bench: &Bench) -> Vec<Attempt> {
    let garbage = |name: &str, header: &'static str, value: &str| Attempt {
        name: name.to_owned(),
        headers: vec![(header, value.to_owned())],
        grant: None,
    };
    let unknown = TokenValue::new(&[0xee; 32]);
    let mut attempts = vec![
        garbage("no credential", "authorization", ""),
        garbage("no scheme", "authorization", &bench.token),
        garbage("another scheme", "authorization", "Basic YWRtaW46YWRtaW4="),
        garbage("an empty token", "authorization", "Bearer "),
        garbage(
            "an unknown session",
            "cookie",
            &format!("fleetcal_session={}", "0".repeat(64)),
        ),
        garbage("no session at all", "cookie", "fleetcal_session=1' OR 1=1"),
        Attempt::bearer("an unknown token", unknown.reveal(), None),
    ];
    let admin = grant(Role::Admin);
    let expired = token(
        &bench.store,
        "expired",
        admin.clone(),
        Some(WallTime(NOW_NS)),
    )
    .await;
    attempts.push(Attempt::bearer("an expired token", &expired, None));
    let revoked = token(&bench.store, "revoked", admin, None).await;
    let tokens = bench.store.tokens(0, 100).await.unwrap();
    let id = tokens.last().unwrap().id;
    let change = TokenChange::Revoke { id };
    let written = change_token(&bench.store, Actor::command_line(), change).await;
    assert_eq!(written.unwrap().record.name.as_str(), "revoked");
    attempts.push(Attempt::bearer("a revoked token", &revoked, None));
    for &role in Role::ALL {
        let name = format!("token-{}", role.as_str());
        let value = token(&bench.store, &name, grant(role), None).await;
        attempts.push(Attempt::bearer(&name, &value, Some(grant(role))));
    }
    let other = Grant::of_token(Role::Robot, Some(robot("b"))).unwrap();
    let value = token(&bench.store, "another robot", other.clone(), None).await;
    attempts.push(Attempt::bearer("another robot", &value, Some(other)));
    for role in [Role::Viewer, Role::Operator, Role::Approver, Role::Admin] {
        attempts.push(Attempt {
            name: format!("session of {}", role.as_str()),
            headers: vec![("cookie", access::signed_in(bench, role).await)],
            grant: Some(grant(role)),
        });
    }
    attempts
}

#[tokio::test]
async fn every_route_lets_in_whom_its_row_names_and_nobody_else() {
    let bench = bench(&["a"]).await;
    let attempts = attempts(&bench).await;
    assert_eq!(attempts.len(), 19);
    for (method, template, access) in TABLE {
        let id = if template.contains("/robots/") {
            "a"
        } else {
            "999999"
        };
        let path = template.replace("{id}", id);
        for attempt in &attempts {
            // The end of its session is what signing out is.
            if *template == "/api/v1/session"
                && *method == "DELETE"
                && attempt.name.starts_with("session")
            {
                continue;
            }
            let headers: Vec<_> = attempt
                .headers
                .iter()
                .map(|(n, v)| (*n, v.as_str()))
                .collect();
            let request = bench.request(method, &path, &headers, "{}");
            let response = bench.routes.clone().oneshot(request).await.unwrap();
            let status = response.status().as_u16();
            let told = format!("{method} {template} by {}: {status}", attempt.name);
            match &attempt.grant {
                _ if *access == Access::Public => assert_ne!(status, 403, "{told}"),
                None => assert_eq!(status, 401, "{told}"),
                Some(grant) if access.permits(grant, Some("a")) => {
                    assert!(![401, 403].contains(&status), "{told}");
                }
                Some(_) => assert_eq!(status, 403, "{told}"),
            }
        }
    }
}

#[tokio::test]
async fn a_route_without_a_row_is_refused_to_an_administrator() {
    use axum::middleware;
    use axum::routing::get;

    let bench = bench(&[]).await;
    let state = crate::ApiState::start(bench.setup.clone());
    let routes = Router::new()
        .route("/api/v1/forgotten", get(|| async { "secret" }))
        .route_layer(middleware::from_fn_with_state(
            state,
            crate::access::authorise,
        ));
    let request = bench.request("GET", "/api/v1/forgotten", &[], "");
    let response = routes.oneshot(request).await.unwrap();
    assert_eq!(response.status().as_u16(), 403);
}
