//! Roll-outs from a client's side, on the real life cycle.

use fleetcal_domain::approval::{Command, DeploymentState, Verification};
use fleetcal_model::RolloutId;
use fleetcal_operations::accounts::{TokenChange, change_token};
use fleetcal_operations::lifecycle::StartRollout;
use fleetcal_patience::until_answered;
use fleetcal_rollout::RolloutRefused;
use fleetcal_store::{AuditFilter, StoreError};
use serde_json::json;

use super::*;

const URI: &str = "/api/v1/rollouts";

/// Robots with a pending proposal of Bo each, and Ana who approves.
struct Rolled {
    bench: Bench,
    ana: String,
}

async fn rolled(robots: &[&str]) -> Rolled {
    let bench = bench(robots).await;
    let bo = token(&bench.store, "bo", grant(Role::Operator), None).await;
    let ana = token(&bench.store, "ana", grant(Role::Approver), None).await;
    let drawn: RobotConfig = serde_json::from_value(json!({
        "model": "bicycle", "wheelbase_m": 1.2, "site": "hamburg",
        "nominal_extrinsics": { "x_m": 0.43, "y_m": 0.0, "yaw_rad": 0.0 },
    }))
    .unwrap();
    for name in robots {
        let done = configure(
            &bench.store,
            &robot(name),
            &drawn,
            Expected::Any,
            Actor::service(),
        );
        done.await.unwrap();
        bench.fleet.configure(&robot(name), drawn.clone()).unwrap();
        let values = json!({ "steering_offset_rad": 0.02, "lidar_x_m": 0.43, "lidar_y_m": 0.01,
            "lidar_yaw_rad": 0.01 });
        let body = json!({ "robot": name, "values": values, "reason": "by tape" });
        let made = bench
            .of(
                &bo,
                "POST",
                "/api/v1/proposals",
                &[("idempotency-key", name)],
                &body,
            )
            .await;
        assert_eq!(made.told(), "201", "{}", made.body);
    }
    Rolled { bench, ana }
}

impl Bench {
    /// Sends a request with a token and a body.
    async fn of(
        &self,
        token: &str,
        method: &str,
        uri: &str,
        headers: &[(&str, &str)],
        body: &Value,
    ) -> Answer {
        let authorization = format!("Bearer {token}");
        let mut all = vec![("authorization", authorization.as_str())];
        all.extend(headers);
        self.send_body(method, uri, &all, body.to_string()).await
    }
}

impl Rolled {
    async fn ana(&self, uri: &str, body: &Value) -> Answer {
        self.bench.of(&self.ana, "POST", uri, &[], body).await
    }

    /// Starts a roll-out with the plan of a dry run; returns its number.
    async fn start(&self, waves: &Value) -> u64 {
        let mut body = json!({ "waves": waves, "reason": "spring" });
        let plan = self.ana(&format!("{URI}?dry_run=true"), &body).await.json();
        body["plan"] = plan["sha256"].clone();
        let started = self.ana(URI, &body).await;
        assert_eq!(started.told(), "201", "{}", started.body);
        started.json()["id"].as_u64().unwrap()
    }

    async fn shown(&self, id: u64) -> Value {
        self.bench.get(&format!("{URI}/{id}")).await.json()
    }

    /// Waits until a condition on the roll-out holds.
    async fn until(&self, id: u64, holds: impl Fn(&Value) -> bool) -> Value {
        let mut shown = Value::Null;
        until_answered("the roll-out is as expected", async || {
            shown = self.shown(id).await;
            holds(&shown)
        })
        .await;
        shown
    }

    /// Answer of a robot about the document that it is offered.
    async fn answers(&self, name: &str, status: &str) {
        let grant = Grant::of_token(Role::Robot, Some(robot(name))).unwrap();
        let own = token(&self.bench.store, &format!("r-{name}"), grant, None).await;
        let uri = format!("/api/v1/robots/{name}/calibration");
        let authorization = format!("Bearer {own}");
        let headers = [("authorization", authorization.as_str())];
        let offered = self.bench.send("GET", &uri, &headers).await.json();
        let document: Value = serde_json::from_str(offered["document"].as_str().unwrap()).unwrap();
        let applied = json!({
            "generation": document["generation"], "sha256": offered["sha256"], "status": status,
            "applied_at_ns": NOW_NS,
        });
        let answer = self
            .bench
            .of(&own, "PUT", &format!("{uri}/applied"), &[], &applied)
            .await;
        assert!(answer.status.is_success(), "{}", answer.told());
    }

    /// Verdict of a verification estimate on what a robot has applied.
    async fn verify(&self, name: &str) {
        let id = robot(name);
        let lifecycle = &self.bench.lifecycle;
        let live = lifecycle.ledger(&id).live.clone().unwrap();
        let generation = live.offer.generation;
        let verification = Verification {
            at_ns: WallTime(NOW_NS),
            distance_m: 80.0,
            residual: [0.0; 4],
            sigma: [0.0; 4],
            within: true,
            limits: None,
            evidence: None,
        };
        let judge = Command::Judge {
            deployment: live.id,
            verification,
        };
        for command in [Command::Confirmed { generation }, judge] {
            let done = lifecycle.decide(&id, command, Actor::service(), None).await;
            done.unwrap();
        }
    }
}

/// Stages of the robots of a wave.
fn stages(shown: &Value, wave: u64) -> Vec<&str> {
    let robots = shown["robots"].as_array().unwrap().iter();
    let of_wave = robots.filter(|robot| robot["wave"] == wave);
    of_wave
        .map(|robot| robot["stage"].as_str().unwrap())
        .collect()
}

#[tokio::test]
async fn a_roll_out_approves_what_its_plan_showed_wave_by_wave() {
    let rolled = rolled(&["a", "b", "c"]).await;
    let body = json!({ "q": "site:hamburg", "waves": [
        { "take": { "robots": 1 } }, { "take": { "q": "c" } }, { "take": "rest" },
    ] });
    let dry = format!("{URI}?dry_run=true");
    let plan = rolled.ana(&dry, &body).await.json();
    let names = |plan: &Value| -> Vec<String> {
        let waves = plan["waves"].as_array().unwrap().iter();
        waves
            .map(|wave| wave["robots"][0]["robot"].as_str().unwrap().to_owned())
            .collect()
    };
    assert_eq!(names(&plan), ["a", "c", "b"], "{plan}");
    assert_eq!(plan["waves"][0]["robots"][0]["second_approver"], false);
    // Without the plan, or with another one, nothing is started.
    let refused = rolled.ana(URI, &body).await.told();
    assert!(refused.starts_with("412 plan_changed [plan]"), "{refused}");
    // With other thresholds it is another plan.
    let mut other = body.clone();
    other["plan"] = plan["sha256"].clone();
    other["waves"][2] = json!({ "take": "rest", "failed_share": 0.5 });
    let refused = rolled.ana(URI, &other).await.told();
    assert!(refused.starts_with("412 plan_changed [plan]"), "{refused}");
    // An operator starts none.
    let operator = token(&rolled.bench.store, "bo2", grant(Role::Operator), None).await;
    let refused = rolled.bench.of(&operator, "POST", URI, &[], &body).await;
    let refused = refused.told();
    assert!(refused.starts_with("403 not_permitted"), "{refused}");
    let mut started = body.clone();
    started["plan"] = plan["sha256"].clone();
    started["reason"] = json!(" ");
    let refused = rolled.ana(URI, &started).await.told();
    assert!(
        refused.starts_with("400 value_refused [reason]"),
        "{refused}"
    );
    started["reason"] = Value::Null;
    let answer = rolled.ana(URI, &started).await.json();
    let id = answer["id"].as_u64().unwrap();
    // Its robots are in no second one.
    let again = rolled.ana(&dry, &body).await.told();
    assert!(again.starts_with("400 value_refused [q]"), "{again}");
    let shown = rolled
        .until(id, |shown| stages(shown, 1) == ["underway"])
        .await;
    assert_eq!(
        (stages(&shown, 2), stages(&shown, 3)),
        (vec!["waiting"], vec!["waiting"])
    );
    let filter = AuditFilter {
        action: Some("proposal.approve".to_owned()),
        limit: 10,
        ..AuditFilter::default()
    };
    let rows = rolled.bench.store.audit(&filter).await.unwrap();
    assert_eq!((rows.len(), rows[0].actor.as_str()), (1, "ana"));
    assert_eq!(rows[0].reason.as_deref(), Some("roll-out 1, wave 1 of 3"));
}

#[tokio::test]
async fn robots_that_refuse_halt_it_and_a_restart_changes_nothing() {
    let mut rolled = rolled(&["a", "b", "c", "d", "e"]).await;
    let id = rolled
        .start(&json!([{ "take": { "robots": 2 } }, { "take": "rest", "verified_share": 0.5 }]))
        .await;
    rolled
        .until(id, |shown| stages(shown, 1) == ["underway", "underway"])
        .await;
    // No instance looks while the robot refuses it; another one on the same database goes on.
    rolled.bench.lifecycle.stop().await;
    rolled.answers("a", "refused").await;
    let Bench {
        store,
        fleet,
        clock,
        ..
    } = &rolled.bench;
    let lifecycle = Lifecycle::start(LifecycleSetup {
        store: store.clone(),
        fleet: fleet.clone(),
        clock: clock.clone(),
        policy: Policy::default(),
        keys: SigningKey::from_bytes(&[7; 32]).into(),
        membership: Membership::alone(),
    });
    rolled.bench.lifecycle = lifecycle.await.unwrap();
    let shown = rolled.until(id, |shown| shown["state"] == "halted").await;
    let reason = &shown["changed"]["reason"];
    assert_eq!(
        reason, "wave 1: 1 of 2 robots have failed, 0 may",
        "{shown}"
    );
    assert_eq!(stages(&shown, 1), ["failed", "underway"]);
    assert_eq!(stages(&shown, 2), ["waiting"; 3]);
    let resume = async |lost: Value| {
        let body = json!({ "reason": "looked at", "lost": lost });
        rolled.ana(&format!("{URI}/{id}/resume"), &body).await
    };
    for read in [json!([]), json!([{ "failed": 0, "left_out": 1 }])] {
        assert_eq!(
            resume(read).await.told(),
            "412 version_conflict: wave 1 has 1 failed robots and 0 left out now: more than you \
             accept"
        );
    }
    let deployments = ["c", "d", "e"].map(|name| rolled.bench.lifecycle.ledger(&robot(name)));
    assert!(
        deployments
            .iter()
            .all(|ledger| ledger.live.is_none() && ledger.open.is_some())
    );
    assert_eq!(
        rolled
            .bench
            .lifecycle
            .ledger(&robot("b"))
            .live
            .as_ref()
            .map(|live| live.state),
        Some(DeploymentState::Queued)
    );
}

#[tokio::test]
async fn a_verified_wave_is_followed_by_the_next_unless_it_is_paused() {
    let rolled = rolled(&["a", "b"]).await;
    let id = rolled
        .start(&json!([{ "take": { "robots": 1 } }, { "take": "rest" }]))
        .await;
    rolled
        .until(id, |shown| stages(shown, 1) == ["underway"])
        .await;
    let change = async |what: &str| {
        rolled
            .ana(&format!("{URI}/{id}/{what}"), &json!({ "reason": "lunch" }))
            .await
    };
    assert_eq!(change("pause").await.json()["state"], "paused");
    let told = change("pause").await.told();
    assert_eq!(
        told,
        "409 wrong_state: the roll-out is paused, and cannot be paused"
    );
    rolled.answers("a", "applied").await;
    rolled.verify("a").await;
    let shown = rolled.shown(id).await;
    assert_eq!(
        (stages(&shown, 1), stages(&shown, 2)),
        (vec!["verified"], vec!["waiting"])
    );
    let stale = [("if-match", "\"1\"")];
    let uri = format!("{URI}/{id}/resume");
    let body = json!({ "reason": "back" });
    let told = rolled
        .bench
        .of(&rolled.ana, "POST", &uri, &stale, &body)
        .await
        .told();
    assert!(told.starts_with("412 version_conflict"), "{told}");
    assert_eq!(change("resume").await.json()["state"], "running");
    rolled
        .until(id, |shown| stages(shown, 2) == ["underway"])
        .await;
    rolled.answers("b", "applied").await;
    rolled.verify("b").await;
    let shown = rolled.until(id, |shown| shown["state"] == "finished").await;
    assert_eq!(shown["waves"][1]["counts"]["verified"], 1);
    let listed = rolled
        .bench
        .get(&format!("{URI}?state=finished"))
        .await
        .json();
    assert_eq!(listed["items"][0]["id"], id);
    assert!(listed["items"][0].get("robots").is_none());
}

#[tokio::test]
async fn a_roll_out_whose_starter_may_not_approve_any_more_halts() {
    let rolled = rolled(&["a", "b"]).await;
    let id = rolled
        .start(&json!([{ "take": { "robots": 1 } }, { "take": "rest" }]))
        .await;
    rolled
        .until(id, |shown| stages(shown, 1) == ["underway"])
        .await;
    let tokens = rolled.bench.store.tokens(0, 10).await.unwrap();
    let ana = tokens
        .iter()
        .find(|one| one.name.as_str() == "ana")
        .unwrap();
    let revoke = TokenChange::Revoke { id: ana.id };
    let done = change_token(&rolled.bench.store, Actor::command_line(), revoke);
    done.await.unwrap();
    rolled.answers("a", "applied").await;
    rolled.verify("a").await;
    let shown = rolled.until(id, |shown| shown["state"] == "halted").await;
    let reason = &shown["changed"]["reason"];
    assert_eq!(
        reason,
        "ana, who started the roll-out, may not approve any more"
    );
    assert_eq!(stages(&shown, 2), ["released"]);
}

#[tokio::test]
async fn a_proposal_is_in_one_roll_out_that_goes_on() {
    let rolled = rolled(&["a", "b"]).await;
    let waves = json!([{ "take": { "robots": 1 } }, { "take": "rest" }]);
    let first = rolled.start(&waves).await;
    rolled
        .until(first, |shown| stages(shown, 1) == ["underway"])
        .await;
    let reason = json!({ "reason": "looked at" });
    let halt = rolled.ana(&format!("{URI}/{first}/halt"), &reason).await;
    assert_eq!(halt.told(), "200");
    let second = rolled.start(&json!([{ "take": "rest" }])).await;
    let resumed = rolled.ana(&format!("{URI}/{first}/resume"), &reason).await;
    assert_eq!(
        resumed.told(),
        "409 robot_taken: roll-out 2, which goes on, has the proposal of robot b"
    );
    // Two starts of the same plan at once: the job itself refuses the later one.
    let robots = rolled.bench.store.rollout_robots(RolloutId(second)).await;
    let members: Vec<_> = robots.unwrap().into_iter().map(|one| one.member).collect();
    let started = rolled.bench.lifecycle.start_rollout(StartRollout {
        q: String::new(),
        waves: Vec::new(),
        members,
        actor: Actor::command_line(),
        reason: None,
        now: WallTime(NOW_NS),
    });
    let taken = RolloutRefused::Taken {
        other: RolloutId(second),
        robot: robot("b"),
    };
    assert_eq!(
        started.await.unwrap_err().to_string(),
        StoreError::from(taken).to_string()
    );
    let rollouts = rolled.bench.get(URI).await.json();
    assert_eq!(rollouts["items"].as_array().unwrap().len(), 2);
}

#[tokio::test]
async fn a_plan_names_the_robots_that_it_leaves_out_with_the_reason() {
    let rolled = rolled(&["a", "b", "c"]).await;
    let values = json!({ "steering_offset_rad": 0.03, "lidar_x_m": 0.43, "lidar_y_m": 0.01,
        "lidar_yaw_rad": 0.01 });
    let body = json!({ "robot": "a", "values": values, "reason": "by tape, again" });
    let key = [("idempotency-key", "again")];
    let uri = "/api/v1/proposals";
    let made = rolled.bench.of(&rolled.ana, "POST", uri, &key, &body).await;
    assert_eq!(made.told(), "201", "{}", made.body);
    let dry = format!("{URI}?dry_run=true");
    let waves = json!([{ "take": { "robots": 1 } }, { "take": "rest" }]);
    let plan = json!({ "waves": waves });
    let left_out = rolled.ana(&dry, &plan).await.json()["left_out"].take();
    assert_eq!(left_out.as_array().unwrap().len(), 1, "{left_out}");
    assert_eq!(left_out[0]["robot"], "a");
    assert_eq!(
        left_out[0]["reason"],
        "ana has proposed it, and somebody else has to approve it"
    );
    rolled.start(&waves).await;
    let cy = token(&rolled.bench.store, "cy", grant(Role::Approver), None).await;
    let plan = rolled.bench.of(&cy, "POST", &dry, &[], &plan).await.json();
    assert_eq!(plan["waves"][0]["robots"][0]["robot"], "a", "{plan}");
    let left_out = plan["left_out"].as_array().unwrap().iter();
    let of_c: Vec<_> = left_out.filter(|one| one["robot"] == "c").collect();
    assert_eq!(of_c.len(), 1, "{plan}");
    assert_eq!(of_c[0]["reason"], "roll-out 1 has it");
}
