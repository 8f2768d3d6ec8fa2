//! Signing in, users, tokens, and the ends of their validity.

use std::time::Duration;

use fleetcal_domain::access::{Password, PasswordHash};
use fleetcal_domain::limits;
use fleetcal_operations::accounts::{UserChange, change_user};
use insta::assert_snapshot;
use serde_json::json;

use super::*;

const PASSWORD: &str = "correct horse battery";
const NOBODY: (&str, &str) = ("authorization", "");

/// Creates a user named after a role, with [`PASSWORD`].
async fn user(bench: &Bench, role: Role) {
    let password = Password::parse(PASSWORD).unwrap();
    let change = UserChange::Create {
        name: AccountName::parse(role.as_str()).unwrap(),
        grant: grant(role),
        password: PasswordHash::of(&password, &[5; 16]).unwrap(),
        key: None,
    };
    let written = change_user(&bench.store, Actor::command_line(), change).await;
    written.unwrap();
}

async fn sign_in(bench: &Bench, name: &str, password: &str) -> Answer {
    let body = json!({"name": name, "password": password}).to_string();
    bench
        .send_body("POST", "/api/v1/session", &[NOBODY], body)
        .await
}

/// Cookie that an answer sets, as a browser returns it.
fn cookie(answer: &Answer) -> String {
    let set = answer.header("set-cookie");
    set.split(';').next().unwrap().to_owned()
}

/// Creates a user of this role and signs in; returns the cookie.
pub(super) async fn signed_in(bench: &Bench, role: Role) -> String {
    user(bench, role).await;
    let answer = sign_in(bench, role.as_str(), PASSWORD).await;
    assert_eq!(answer.told(), "201");
    cookie(&answer)
}

async fn with(bench: &Bench, method: &str, uri: &str, cookie: &str, body: &str) -> Answer {
    let headers = [("cookie", cookie)];
    bench
        .send_body(method, uri, &headers, body.to_owned())
        .await
}

#[tokio::test]
async fn the_first_administrator_is_made_by_the_link_once() {
    let bench = bench(&[]).await;
    let anonymous = bench.send("GET", "/api/v1/session", &[NOBODY]).await;
    assert_snapshot!(anonymous.told(), @"401 setup_required: there are no users yet; open the setup link that the service printed at its start, or make one with `fleetcal user create`");
    assert!(anonymous.header("www-authenticate").starts_with("Bearer"));
    let set_up = async |code: &str, name: &str, password: &str| {
        let body = json!({"code": code, "name": name, "password": password}).to_string();
        bench
            .send_body("POST", "/api/v1/setup", &[NOBODY], body)
            .await
    };
    let code = bench.setup_code.as_str();
    assert_snapshot!(set_up("guess", "ann", PASSWORD).await.told(), @"403 setup_code_refused [code]: the setup code is wrong or older than a day; a service without users prints a new one at each start");
    assert_snapshot!(set_up(code, "", PASSWORD).await.told(), @r#"422 body_refused [name]: name: got "", expected 1 to 64 letters, digits, spaces, and . _ - @ + in between, and not "fleetcal""#);
    assert_snapshot!(set_up(code, "ann", "secret").await.told(), @"422 password_refused [password]: password: got 6 characters, expected 12 to 128");
    let (one, other) = tokio::join!(set_up(code, "ann", PASSWORD), set_up(code, "bob", PASSWORD));
    let mut statuses = [one.status.as_u16(), other.status.as_u16()];
    statuses.sort_unstable();
    assert_eq!(statuses, [201, 409]);
    let admin = if one.status.as_u16() == 201 {
        one
    } else {
        other
    };
    assert_eq!(admin.json()["role"], "admin");
    let session = with(&bench, "GET", "/api/v1/session", &cookie(&admin), "").await;
    assert_eq!(session.told(), "200");
    assert_snapshot!(set_up(code, "eve", PASSWORD).await.told(), @"409 already_set_up: there are users already; sign in as one of them");
    let anonymous = bench.send("GET", "/api/v1/session", &[NOBODY]).await;
    assert_snapshot!(anonymous.told(), @"401 credential_missing: sign in, or send a token as `Authorization: Bearer cal_…`");
}

#[tokio::test]
async fn a_setup_code_of_yesterday_does_not_count() {
    let bench = bench(&[]).await;
    bench.clock.advance(Duration::from_hours(24));
    let body = json!({"code": bench.setup_code, "name": "ann", "password": PASSWORD});
    let answer = bench
        .send_body("POST", "/api/v1/setup", &[NOBODY], body.to_string())
        .await;
    assert!(answer.told().starts_with("403 setup_code_refused"));
}

#[tokio::test]
async fn a_person_signs_in_and_out() {
    let bench = bench(&["a"]).await;
    user(&bench, Role::Operator).await;
    let signed_in = sign_in(&bench, "Operator", PASSWORD).await;
    assert_eq!(
        signed_in.json(),
        json!({"name": "operator", "role": "operator", "credential": "session",
               "ends": "2026-01-01T12:00:00Z"})
    );
    assert_eq!(signed_in.header("cache-control"), "no-store");
    let set = signed_in.header("set-cookie");
    assert!(
        set.ends_with("; Path=/; Max-Age=604800; HttpOnly; SameSite=Strict"),
        "{set}"
    );
    let cookie = cookie(&signed_in);
    let note = r#"{"kind": "maintenance", "note": "greased"}"#;
    let noted = with(&bench, "POST", "/api/v1/robots/a/events", &cookie, note).await;
    assert_eq!(noted.json()["author"], "operator");
    let out = with(&bench, "DELETE", "/api/v1/session", &cookie, "").await;
    assert_eq!(out.told(), "204");
    assert!(out.header("set-cookie").contains("Max-Age=0"));
    let after = with(&bench, "GET", "/api/v1/session", &cookie, "").await;
    assert_snapshot!(after.told(), @"401 session_ended: the session has ended; sign in");
}

#[tokio::test]
async fn a_wrong_password_and_an_unknown_name_are_answered_alike_and_limited() {
    let bench = bench(&[]).await;
    user(&bench, Role::Viewer).await;
    let wrong = sign_in(&bench, "viewer", "wrong horse battery").await;
    let unknown = sign_in(&bench, "nobody", "wrong horse battery").await;
    assert_snapshot!(wrong.told(), @"401 sign_in_refused: name or password is wrong");
    assert_eq!((wrong.told(), wrong.body), (unknown.told(), unknown.body));
    for _ in 1..limits::SIGN_IN_NAME_BURST {
        assert_eq!(sign_in(&bench, "VIEWER", "x").await.status.as_u16(), 401);
    }
    let refused = sign_in(&bench, "viewer", PASSWORD).await;
    assert_snapshot!(refused.told(), @"429 too_many_tries: too many tries; try again in 31 s");
    assert_eq!(refused.header("retry-after"), "31");
    bench.clock.advance(Duration::from_secs(31));
    assert_eq!(sign_in(&bench, "viewer", PASSWORD).await.told(), "201");
    // The right password ends the count.
    assert_eq!(sign_in(&bench, "viewer", "x").await.status.as_u16(), 401);
    // One address does not try names without end either.
    let mut last = 0;
    for number in 0..limits::SIGN_IN_ADDRESS_BURST {
        last = sign_in(&bench, &format!("name {number}"), "x")
            .await
            .status
            .as_u16();
    }
    assert_eq!(last, 429);
}

#[tokio::test]
async fn a_session_ends_idle_old_or_by_a_change_of_its_user() {
    let bench = bench(&[]).await;
    let viewer = signed_in(&bench, Role::Viewer).await;
    let status = async |cookie: &str| {
        let answer = with(&bench, "GET", "/api/v1/session", cookie, "").await;
        answer.status.as_u16()
    };
    bench.clock.advance(Duration::from_hours(12));
    assert_eq!(status(&viewer).await, 401);
    let viewer = cookie(&sign_in(&bench, "viewer", PASSWORD).await);
    for _ in 0..(7 * 24 / 11) {
        bench.clock.advance(Duration::from_hours(11));
        assert_eq!(status(&viewer).await, 200);
        bench.store.flush().await.unwrap();
    }
    bench.clock.advance(Duration::from_hours(11));
    assert_eq!(status(&viewer).await, 401);
    let edit = async |etag: &str, body: &str| {
        let headers = [("if-match", etag)];
        let answer = bench
            .send_body("PATCH", "/api/v1/users/1", &headers, body.to_owned())
            .await;
        answer.told()
    };
    let viewer = cookie(&sign_in(&bench, "viewer", PASSWORD).await);
    assert_eq!(edit("\"1\"", r#"{"role": "operator"}"#).await, "200");
    assert_eq!(status(&viewer).await, 200);
    let new = r#"{"password": "another horse battery"}"#;
    assert_eq!(edit("\"2\"", new).await, "200");
    assert_eq!(status(&viewer).await, 401);
    assert_eq!(
        sign_in(&bench, "viewer", PASSWORD).await.status.as_u16(),
        401
    );
    let viewer = cookie(&sign_in(&bench, "viewer", "another horse battery").await);
    assert_eq!(edit("\"3\"", r#"{"disabled": true}"#).await, "200");
    assert_eq!(status(&viewer).await, 401);
    let told = sign_in(&bench, "viewer", "another horse battery")
        .await
        .told();
    assert_snapshot!(told, @"401 sign_in_refused: name or password is wrong");
}

#[tokio::test]
async fn a_user_has_so_many_sessions_and_the_oldest_goes() {
    let bench = bench(&[]).await;
    let first = signed_in(&bench, Role::Viewer).await;
    let mut second = String::new();
    for number in 0..limits::SESSIONS_PER_USER_MAX {
        let next = cookie(&sign_in(&bench, "viewer", PASSWORD).await);
        if number == 0 {
            second = next;
        }
    }
    let status = async |cookie: &str| {
        let answer = with(&bench, "GET", "/api/v1/session", cookie, "").await;
        answer.status.as_u16()
    };
    assert_eq!((status(&first).await, status(&second).await), (401, 200));
}

#[tokio::test]
async fn a_person_changes_the_own_password() {
    let bench = bench(&[]).await;
    let here = signed_in(&bench, Role::Viewer).await;
    let elsewhere = cookie(&sign_in(&bench, "viewer", PASSWORD).await);
    let change = async |current: &str, password: &str| {
        let body = json!({"current": current, "password": password}).to_string();
        with(&bench, "POST", "/api/v1/session/password", &here, &body)
            .await
            .told()
    };
    assert_snapshot!(change("wrong", "another horse battery").await, @"409 password_wrong [current]: the current password is wrong");
    assert_snapshot!(change(PASSWORD, "short").await, @"422 password_refused [password]: password: got 5 characters, expected 12 to 128");
    assert_eq!(change(PASSWORD, "another horse battery").await, "204");
    let status = async |cookie: &str| {
        let answer = with(&bench, "GET", "/api/v1/session", cookie, "").await;
        answer.status.as_u16()
    };
    assert_eq!((status(&here).await, status(&elsewhere).await), (200, 401));
    let by_token = bench
        .send_body(
            "POST",
            "/api/v1/session/password",
            &[],
            r#"{"current": "x", "password": "y"}"#,
        )
        .await;
    assert_snapshot!(by_token.told(), @"400 not_a_session: this is for people who signed in, not for tokens");
}

#[tokio::test]
async fn users_are_made_changed_and_removed_with_conditions() {
    let bench = bench(&[]).await;
    let post = async |key: &str, body: Value| {
        let headers = [("idempotency-key", key)];
        bench
            .send_body("POST", "/api/v1/users", &headers, body.to_string())
            .await
    };
    let ann = json!({"name": "Ann", "role": "admin", "password": PASSWORD});
    let made = post("k1", ann.clone()).await;
    assert_eq!(
        (made.told(), made.header("etag")),
        ("201".to_owned(), "\"1\"")
    );
    assert_eq!(
        made.json(),
        json!({"id": 1, "name": "Ann", "role": "admin", "disabled": false, "version": 1,
               "created": "2026-01-01T00:00:00Z", "updated": "2026-01-01T00:00:00Z",
               "signed_in": null})
    );
    assert_eq!(post("k1", ann.clone()).await.json(), made.json());
    let other = json!({"name": "Bob", "role": "admin", "password": PASSWORD});
    assert!(
        post("k1", other.clone())
            .await
            .told()
            .starts_with("422 idempotency_key_reused")
    );
    let lower = json!({"name": "ann", "role": "viewer", "password": PASSWORD});
    assert_snapshot!(post("k2", lower).await.told(), @"409 name_taken: the name ann is taken");
    let robot = json!({"name": "r", "role": "robot", "password": PASSWORD});
    assert_snapshot!(post("k2", robot).await.told(), @r#"422 body_refused [role]: role: got "robot", expected viewer, operator, approver or admin for a person"#);
    let send = async |method: &str, etag: &str, body: &str| {
        let headers: &[(&str, &str)] = if etag.is_empty() {
            &[]
        } else {
            &[("if-match", etag)]
        };
        let answer = bench
            .send_body(method, "/api/v1/users/1", headers, body.to_owned())
            .await;
        answer.told()
    };
    let viewer = r#"{"role": "viewer"}"#;
    assert!(send("PATCH", "", viewer).await.starts_with("428"));
    assert_snapshot!(send("PATCH", "\"7\"", viewer).await, @"412 version_conflict: user 1 is at version 1");
    assert_snapshot!(send("PATCH", "\"1\"", "{}").await, @"422 body_refused: the body: give at least one of role, disabled, password");
    assert_snapshot!(send("PATCH", "\"1\"", viewer).await, @"409 last_admin: this is the last administrator that can sign in; make another one first");
    assert!(
        send("PATCH", "\"1\"", r#"{"disabled": true}"#)
            .await
            .starts_with("409 last_admin")
    );
    assert!(
        send("DELETE", "\"1\"", "")
            .await
            .starts_with("409 last_admin")
    );
    assert_eq!(post("k3", other).await.told(), "201");
    assert_eq!(send("PATCH", "\"1\"", viewer).await, "200");
    assert!(send("DELETE", "\"1\"", "").await.starts_with("412"));
    assert_eq!(send("DELETE", "\"2\"", "").await, "204");
    assert_snapshot!(bench.get("/api/v1/users/1").await.told(), @"404 user_unknown: no user 1 is known");
    let page = bench.get("/api/v1/users?limit=1").await.json();
    assert_eq!(
        (&page["items"][0]["name"], page.get("next")),
        (&json!("Bob"), None)
    );
}

#[tokio::test]
async fn a_token_is_shown_once_and_counts_until_it_is_revoked() {
    let bench = bench(&["a"]).await;
    let post = async |key: &str, body: Value| {
        let headers = [("idempotency-key", key)];
        bench
            .send_body("POST", "/api/v1/tokens", &headers, body.to_string())
            .await
    };
    let asked = json!({"name": "ci", "role": "viewer", "expires": "2026-01-02T00:00:00Z"});
    let made = post("k", asked.clone()).await;
    assert_eq!(
        (made.told(), made.header("cache-control")),
        ("201".to_owned(), "no-store")
    );
    let made = made.json();
    let value = made["value"].as_str().unwrap();
    assert!(value.starts_with("cal_"));
    let again = post("k", asked.clone()).await.json();
    assert_eq!((&again["id"], again.get("value")), (&made["id"], None));
    assert_snapshot!(post("k2", asked).await.told(), @"409 name_taken: the name ci is taken");
    let bearer = format!("Bearer {value}");
    let robots = async || {
        let headers = [("authorization", bearer.as_str())];
        bench.send("GET", "/api/v1/robots", &headers).await.told()
    };
    assert_eq!(robots().await, "200");
    bench.store.flush().await.unwrap();
    let list = bench.get("/api/v1/tokens?limit=2").await.json();
    let shown = &list["items"][1];
    assert_eq!(
        (
            &shown["state"],
            &shown["created_by"],
            &shown["last_used"],
            shown.get("value")
        ),
        (
            &json!("valid"),
            &json!("tester"),
            &json!("2026-01-01T00:00:00Z"),
            None
        )
    );
    bench.clock.advance(Duration::from_hours(24));
    assert_snapshot!(robots().await, @"401 token_expired: the token has expired");
    let revoke = async |id: &str| {
        bench
            .send("DELETE", &format!("/api/v1/tokens/{id}"), &[])
            .await
            .told()
    };
    let id = made["id"].to_string();
    assert_eq!(
        (revoke(&id).await, revoke(&id).await),
        ("204".to_owned(), "204".to_owned())
    );
    assert_snapshot!(robots().await, @"401 token_revoked: the token was revoked");
    assert_snapshot!(revoke("77").await, @"404 token_unknown: no token 77 is known");
    assert_snapshot!(revoke("x").await, @r#"400 value_refused [id]: id: got "x", expected a number"#);
}

#[tokio::test]
async fn a_token_is_refused_by_field() {
    let bench = bench(&[]).await;
    let told = async |body: Value| {
        let answer = bench
            .send_body("POST", "/api/v1/tokens", &[], body.to_string())
            .await;
        answer.told()
    };
    assert_snapshot!(told(json!({"name": "r", "role": "robot"})).await, @"422 body_refused [robot]: a token of role robot is bound to one robot: name it");
    assert_snapshot!(told(json!({"name": "r", "role": "viewer", "robot": "a"})).await, @"422 body_refused [robot]: only a token of role robot is bound to a robot, not one of role viewer");
    assert_snapshot!(told(json!({"name": "r", "role": "viewer", "expires": "2025-01-01T00:00:00Z"})).await, @r#"400 value_refused [expires]: expires: got "2025-01-01T00:00:00Z", expected a time to come, within ten years"#);
    assert!(
        told(json!({"name": "a\nb", "role": "viewer"}))
            .await
            .starts_with("422 body_refused [name]")
    );
}

#[tokio::test]
async fn a_page_of_another_site_gives_no_orders() {
    let bench = bench(&["a"]).await;
    let operator = signed_in(&bench, Role::Operator).await;
    let post = async |headers: &[(&str, &str)]| {
        let headers: Vec<_> = [("cookie", operator.as_str()), ("host", "fleet:8080")]
            .iter()
            .chain(headers)
            .copied()
            .collect();
        let body = r#"{"kind": "maintenance"}"#;
        let answer = bench
            .send_body("POST", "/api/v1/robots/a/events", &headers, body)
            .await;
        answer.told()
    };
    assert_eq!(post(&[("sec-fetch-site", "same-origin")]).await, "201");
    assert_eq!(post(&[("origin", "http://fleet:8080")]).await, "201");
    for headers in [
        [("sec-fetch-site", "cross-site")],
        [("sec-fetch-site", "same-site")],
        [("origin", "http://evil.example")],
        [("origin", "http://fleet:8081")],
        [("origin", "null")],
    ] {
        assert_eq!(
            post(&headers).await,
            "403 cross_origin: the request comes from a page of another site",
            "{headers:?}"
        );
    }
    let headers = [NOBODY, ("sec-fetch-site", "cross-site")];
    let body = json!({"name": "operator", "password": PASSWORD}).to_string();
    let told = bench
        .send_body("POST", "/api/v1/session", &headers, body)
        .await
        .told();
    assert!(told.starts_with("403 cross_origin"), "{told}");
}

#[tokio::test]
async fn a_stream_ends_with_the_permission_to_hear_it() {
    let bench = bench(&[]).await;
    let viewer = token(&bench.store, "viewer", grant(Role::Viewer), None).await;
    let bearer = format!("Bearer {viewer}");
    let mut stream = bench
        .begin("/api/v1/stream", &[("authorization", bearer.as_str())])
        .await;
    assert_eq!(next_event(&mut stream).await.0, "ready");
    let id = bench.store.tokens(0, 10).await.unwrap().last().unwrap().id;
    let change = TokenChange::Revoke { id };
    let written = change_token(&bench.store, Actor::command_line(), change).await;
    written.unwrap();
    let ending = async { while stream.next().await.is_some() {} };
    let ended = tokio::time::timeout(Duration::from_secs(30), ending).await;
    ended.expect("the stream ends with the token");
}
