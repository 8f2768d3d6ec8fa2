//! Alerts, webhooks, and the outbox between a commit and its sending, on the real database.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

use fleetcal_contract::TestDatabase;
use fleetcal_domain::access::{Authentication, Role};
use fleetcal_domain::alert::{AlertDocument, AlertRefused, Observation, Sighting, StoredAlert};
use fleetcal_domain::limits;
use fleetcal_domain::webhook::{
    Attempt, DeliveryState, Secret, Webhook, WebhookEvent, WebhookRefused, WebhookUrl,
};
use fleetcal_model::{AlertId, Version, WallTime, WebhookId};
use fleetcal_store::{AlertFilter, AlertSelection, AuditFilter};

use super::*;
use crate::testing::{NOW_NS, clock, open, robot};
use crate::webhook_dispatcher::{CreateWebhook, DeleteWebhook, NoteAttempt};

const NS: i64 = 1_000_000_000;
const NOW_S: i64 = NOW_NS / NS;

/// Variable that names the child process's database.
const DATABASE: &str = "FLEETCAL_TEST_STORE";
/// Name of the child's test.
const CHILD: &str = "alert_evaluator::tests::child_that_is_killed";

fn ada() -> Actor {
    Actor {
        name: "ada".to_owned(),
        authentication: Authentication::Session,
        role: Some(Role::Operator),
        request: None,
    }
}

async fn observe(
    store: &Store,
    name: &str,
    kind: AlertKind,
    observation: Observation,
    at_s: i64,
) -> Vec<AlertChange> {
    let sighting = Sighting {
        kind,
        observation,
        what: format!("seen at {at_s}"),
        robots: Vec::new(),
    };
    let write = Observe {
        sightings: vec![(robot(name).into(), sighting)],
        policy: Arc::new(AlertPolicy::default()),
        standing: BTreeMap::new(),
        evaluator: None,
        now: WallTime((NOW_S + at_s) * NS),
    };
    store.transact(write).await.unwrap()
}

async fn acknowledge(store: &Store, id: u64, version: Version) -> Result<Alert, StoreError> {
    let write = Acknowledge {
        id: AlertId(id),
        version,
        actor: ada(),
        note: Some("on my way".to_owned()),
        now: WallTime(NOW_S * NS),
    };
    store.transact(write).await
}

async fn all(store: &Store, selection: Option<AlertSelection>) -> Vec<Alert> {
    let filter = AlertFilter {
        selection,
        limit: 1_000,
        ..AlertFilter::default()
    };
    let stored = store.alerts(&filter).await.unwrap().into_iter();
    stored.filter_map(StoredAlert::known).collect()
}

async fn create(store: &Store, url: &str, events: &[WebhookEvent]) -> Result<Webhook, StoreError> {
    let write = CreateWebhook {
        url: WebhookUrl::parse(url).unwrap(),
        events: events.to_vec(),
        secret: Secret::from_bytes(vec![7; 32]),
        actor: ada(),
        now: WallTime(NOW_S * NS),
    };
    store.transact(write).await
}

#[tokio::test]
async fn an_alert_is_one_until_it_is_over_and_survives_a_restart() {
    use Observation::{Clear, Firing, Unknown};
    let database = TestDatabase::new().await;
    let store = open(&database, &clock()).await;
    for (observation, at_s) in [
        (Firing, 0),
        (Firing, 5),
        (Firing, 10),
        (Unknown, 11),
        (Firing, 12),
        (Clear, 13),
    ] {
        observe(&store, "a", AlertKind::Drift, observation, at_s).await;
    }
    // A pending one that comes to nothing leaves nothing.
    observe(&store, "b", AlertKind::Drift, Firing, 20).await;
    let dropped = observe(&store, "b", AlertKind::Drift, Clear, 21).await;
    assert!(matches!(&dropped[..], [AlertChange::Dropped(_)]));
    store.close().await.unwrap();
    drop(store);
    let store = open(&database, &clock()).await;
    let active = store.active_alerts().await.unwrap();
    assert_eq!(active.len(), 1);
    assert_eq!(active[0].condition.name(), ConditionName::Recovering);
    observe(&store, "a", AlertKind::Drift, Clear, 73).await;
    assert!(store.active_alerts().await.unwrap().is_empty());
    let (alert, history) = store.alert(active[0].id).await.unwrap().unwrap();
    let alert = alert.known().unwrap();
    assert_eq!(alert.ended_ns, Some(WallTime((NOW_S + 73) * NS)));
    let went: Vec<_> = history
        .iter()
        .map(|moment| (moment.state.as_str(), moment.at_ns.whole_s() - NOW_S))
        .collect();
    assert_eq!(
        went,
        [
            ("pending", 0),
            ("alerting", 10),
            ("no_data", 11),
            ("alerting", 12),
            ("recovering", 13),
            ("normal", 73),
        ]
    );
    // What begins again is another one, whose number was never used.
    observe(&store, "a", AlertKind::Drift, Firing, 80).await;
    let again = store.active_alerts().await.unwrap();
    assert!(again[0].id > active[0].id.next(), "{}", again[0].id);
}

#[tokio::test]
async fn the_most_urgent_come_first_and_pages_do_not_overlap() {
    use Observation::{Clear, Firing};
    let database = TestDatabase::new().await;
    let store = open(&database, &clock()).await;
    for (name, kind) in [
        ("over", AlertKind::NotApplied),
        ("slow", AlertKind::NoData),
        ("odd", AlertKind::NotApplied),
        ("lost", AlertKind::RollbackFailed),
        ("bad", AlertKind::VerificationFailed),
        ("odder", AlertKind::NotApplied),
    ] {
        observe(&store, name, kind, Firing, 0).await;
    }
    observe(&store, "over", AlertKind::NotApplied, Clear, 1).await;
    let names = |alerts: &[Alert]| -> Vec<String> {
        alerts.iter().map(|alert| alert.robot.to_string()).collect()
    };
    let order = ["lost", "bad", "odder", "odd", "slow", "over"];
    assert_eq!(names(&all(&store, None).await), order);
    let active = all(&store, Some(AlertSelection::Active)).await;
    assert_eq!(names(&active), &order[..5]);
    let pending = AlertSelection::In(ConditionName::Pending);
    assert_eq!(names(&all(&store, Some(pending)).await), ["slow"]);
    let mut paged = Vec::new();
    let mut after = None;
    loop {
        let filter = AlertFilter {
            after,
            limit: 2,
            ..AlertFilter::default()
        };
        let page = store.alerts(&filter).await.unwrap();
        let Some(last) = page.last() else { break };
        after = Some((last.rank(), last.id().0 as i64));
        let page = page.into_iter().filter_map(StoredAlert::known);
        paged.extend(names(&page.collect::<Vec<_>>()));
    }
    assert_eq!(paged, order);
}

#[tokio::test]
async fn an_acknowledgement_is_audited_and_the_second_one_is_refused() {
    let database = TestDatabase::new().await;
    let store = open(&database, &clock()).await;
    observe(&store, "a", AlertKind::NotApplied, Observation::Firing, 0).await;
    let id = store.active_alerts().await.unwrap()[0].id;
    let unknown = acknowledge(&store, id.next().0, Version(1))
        .await
        .unwrap_err();
    assert!(matches!(
        unknown,
        StoreError::Alert(AlertRefused::Unknown(_))
    ));
    let taken = acknowledge(&store, id.0, Version(1)).await.unwrap();
    assert_eq!((taken.version, taken.id), (Version(2), id));
    let stale = acknowledge(&store, id.0, Version(1)).await.unwrap_err();
    assert!(matches!(
        stale,
        StoreError::Alert(AlertRefused::Stale { found: Version(2) })
    ));
    let twice = acknowledge(&store, id.0, Version(2)).await.unwrap_err();
    assert!(matches!(
        twice,
        StoreError::Alert(AlertRefused::AcknowledgedAlready(_))
    ));
    let filter = AuditFilter {
        limit: 10,
        ..AuditFilter::default()
    };
    let audit = store.audit(&filter).await.unwrap();
    assert_eq!(audit.len(), 1);
    let row = &audit[0];
    assert_eq!(
        (row.action.as_str(), row.actor.as_str()),
        ("alert.acknowledge", "ada")
    );
    assert_eq!(
        row.before.as_ref().unwrap()["acknowledgement"],
        serde_json::Value::Null
    );
    assert_eq!(
        row.after.as_ref().unwrap()["acknowledgement"]["note"],
        "on my way"
    );
    let (_, history) = store.alert(id).await.unwrap().unwrap();
    assert_eq!(history.last().unwrap().by.as_deref(), Some("ada"));
    assert_eq!(history[0].by, None);
}

#[tokio::test]
async fn each_webhook_is_told_of_its_events_alone_and_goes_with_its_messages() {
    use Observation::{Clear, Firing};
    let database = TestDatabase::new().await;
    let store = open(&database, &clock()).await;
    let every = create(&store, "http://a/", &WebhookEvent::ALL)
        .await
        .unwrap();
    let ends = create(&store, "http://b/", &[WebhookEvent::AlertResolved]);
    let ends = ends.await.unwrap();
    let taken = create(&store, "http://a/", &WebhookEvent::ALL).await;
    let taken = taken.unwrap_err();
    assert!(matches!(taken, StoreError::Webhook(WebhookRefused::UrlTaken(id)) if id == every.id));
    observe(&store, "r", AlertKind::NotApplied, Firing, 0).await;
    observe(&store, "r", AlertKind::NotApplied, Clear, 1).await;
    let told = async |webhook: WebhookId| {
        let deliveries = store.deliveries(webhook, None, 100).await.unwrap();
        deliveries
            .iter()
            .map(|one| one.event.as_str())
            .collect::<Vec<_>>()
    };
    assert_eq!(told(every.id).await, ["alert.resolved", "alert.alerting"]);
    assert_eq!(told(ends.id).await, ["alert.resolved"]);
    // The oldest of each, once it is due.
    let due = store
        .due_deliveries(WallTime((NOW_S + 1) * NS))
        .await
        .unwrap();
    let events: Vec<_> = due.iter().map(|one| one.delivery.event.as_str()).collect();
    assert_eq!(events, ["alert.alerting", "alert.resolved"]);
    assert_eq!(store.waiting_deliveries().await.unwrap(), 3);
    let gone = DeleteWebhook {
        id: every.id,
        actor: ada(),
        now: WallTime(0),
    };
    store.transact(gone.clone()).await.unwrap();
    let unknown = store.transact(gone).await.unwrap_err();
    assert!(matches!(
        unknown,
        StoreError::Webhook(WebhookRefused::Unknown(_))
    ));
    assert_eq!(store.waiting_deliveries().await.unwrap(), 1);
    let filter = AuditFilter {
        action: Some("webhook.".to_owned()),
        limit: 10,
        ..AuditFilter::default()
    };
    let audit = store.audit(&filter).await.unwrap();
    let actions: Vec<_> = audit.iter().map(|row| row.action.as_str()).collect();
    assert_eq!(
        actions,
        ["webhook.delete", "webhook.create", "webhook.create"]
    );
    assert!(!format!("{audit:?}").contains("secret"));
}

#[tokio::test]
async fn there_are_so_many_webhooks_and_no_more() {
    let database = TestDatabase::new().await;
    let store = open(&database, &clock()).await;
    for number in 0..limits::WEBHOOKS_MAX {
        let url = format!("http://receiver/{number}");
        create(&store, &url, &WebhookEvent::ALL).await.unwrap();
    }
    let refused = create(&store, "http://one.more/", &WebhookEvent::ALL).await;
    assert!(matches!(
        refused.unwrap_err(),
        StoreError::Webhook(WebhookRefused::TooMany)
    ));
}

#[tokio::test]
async fn too_many_that_wait_or_are_done_shed_their_oldest() {
    use Observation::{Clear, Firing};
    let database = TestDatabase::new().await;
    let store = open(&database, &clock()).await;
    let webhook = create(&store, "http://a/", &WebhookEvent::ALL)
        .await
        .unwrap();
    let messages = limits::WEBHOOK_WAITING_MAX + limits::WEBHOOK_LOG_MAX + 10;
    let sighting = |number: u32| Sighting {
        kind: AlertKind::NotApplied,
        observation: if number.is_multiple_of(2) {
            Firing
        } else {
            Clear
        },
        what: String::new(),
        robots: Vec::new(),
    };
    let write = Observe {
        sightings: (0..messages)
            .map(|number| (robot("a").into(), sighting(number)))
            .collect(),
        policy: Arc::new(AlertPolicy::default()),
        standing: BTreeMap::new(),
        evaluator: None,
        now: WallTime(NOW_S * NS),
    };
    store.transact(write).await.unwrap();
    assert_eq!(
        store.waiting_deliveries().await.unwrap(),
        u64::from(limits::WEBHOOK_WAITING_MAX)
    );
    let kept = store.deliveries(webhook.id, None, 10_000).await.unwrap();
    let dropped = kept
        .iter()
        .filter(|one| one.state == DeliveryState::GivenUp);
    assert_eq!(dropped.count(), limits::WEBHOOK_LOG_MAX as usize);
}

#[tokio::test]
async fn an_attempt_is_written_down_and_the_next_one_waits() {
    let database = TestDatabase::new().await;
    let store = open(&database, &clock()).await;
    create(&store, "http://a/", &WebhookEvent::ALL)
        .await
        .unwrap();
    observe(&store, "r", AlertKind::NotApplied, Observation::Firing, 0).await;
    let due = store.due_deliveries(WallTime(NOW_S * NS)).await.unwrap();
    let attempt = |status| NoteAttempt {
        delivery: due[0].delivery.id,
        attempt: Attempt {
            at_ns: WallTime(NOW_S * NS),
            took_ms: 3,
            status,
            error: None,
        },
        now: WallTime(NOW_S * NS),
        jitter: 0.0,
    };
    store.transact(attempt(Some(503))).await.unwrap();
    let at = async |seconds: i64| {
        store
            .due_deliveries(WallTime((NOW_S + seconds) * NS))
            .await
            .unwrap()
    };
    assert!(at(4).await.is_empty());
    assert_eq!(at(5).await.len(), 1);
    // A clock that was set back by a day does not make it wait for a day.
    assert_eq!(at(-86_400).await.len(), 1);
    store.transact(attempt(Some(204))).await.unwrap();
    assert!(at(900).await.is_empty());
    let log = store.deliveries(due[0].delivery.webhook, None, 10).await;
    let log = log.unwrap();
    assert_eq!(
        (log[0].state, log[0].attempts_made),
        (DeliveryState::Delivered, 2)
    );
    assert_eq!(log[0].message, due[0].delivery.message);
}

/// Child process that begins one alert after another, and prints each committed one, until its
/// parent kills it.
#[tokio::test]
#[ignore = "is the child of a_kill_between_commit_and_sending_loses_no_message"]
async fn child_that_is_killed() {
    let database = TestDatabase::at(&std::env::var(DATABASE).unwrap());
    let store = open(&database, &clock()).await;
    let begun = all(&store, None).await.len();
    for number in begun..begun + 1_000_000 {
        let name = format!("r{number}");
        let kind = AlertKind::NotApplied;
        observe(&store, &name, kind, Observation::Firing, 0).await;
        println!("committed {name}");
    }
}

#[tokio::test]
async fn a_kill_between_commit_and_sending_loses_no_message() {
    let database = TestDatabase::new().await;
    let store = open(&database, &clock()).await;
    let webhook = create(&store, "http://a/", &WebhookEvent::ALL)
        .await
        .unwrap();
    store.close().await.unwrap();
    drop(store);
    let mut committed = Vec::new();
    for kill_after in [1, 7, 40] {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", CHILD, "--ignored", "--nocapture"])
            .env(DATABASE, database.address())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let mut told = 0;
        for line in lines.map_while(Result::ok) {
            let Some((_, name)) = line.split_once("committed ") else {
                continue;
            };
            committed.push(name.to_owned());
            told += 1;
            if told == kill_after {
                child.kill().unwrap();
            }
        }
        assert!(told >= kill_after, "the child ended by itself");
        child.wait().unwrap();
    }
    let store = open(&database, &clock()).await;
    let waiting = store.deliveries(webhook.id, None, 10_000).await.unwrap();
    let alerts = all(&store, None).await;
    assert_eq!(waiting.len(), alerts.len(), "one message for each alert");
    for name in committed {
        let told = |body: &str| body.contains(&format!("\"robot\":\"{name}\""));
        assert!(waiting.iter().any(|one| told(&one.body)), "{name} is lost");
    }
}

/// Checks an upgrade of a cluster: an instance of a newer version has stored a kind and a condition
/// that this version does not know.
#[tokio::test]
async fn alerts_of_a_newer_version_are_shown_by_their_names_and_left_alone() {
    use Observation::{Clear, Firing};
    let database = TestDatabase::in_sqlite();
    let store = open(&database, &clock()).await;
    for (name, kind) in [("a", AlertKind::Drift), ("b", AlertKind::NotApplied)] {
        observe(&store, name, kind, Firing, 0).await;
        observe(&store, name, kind, Firing, 60).await;
    }
    let by_newer = "
        INSERT INTO alert (record, rank)
        SELECT json_set(record, '$.kind', 'tyre_pressure', '$.robot', 'c'), 2 FROM alert
        WHERE kind = 'drift';
        UPDATE alert SET record = json_set(record, '$.condition.state', 'suppressed')
        WHERE kind = 'not_applied';
        UPDATE alert_change SET state = 'suppressed' WHERE alert IN
            (SELECT id FROM alert WHERE kind = 'not_applied')";
    database.execute(by_newer).await;

    let filter = AlertFilter {
        limit: 10,
        ..AlertFilter::default()
    };
    let stored = store.alerts(&filter).await.unwrap();
    let documents: Vec<_> = stored.iter().map(AlertDocument::of_stored).collect();
    let shown: Vec<_> = documents
        .iter()
        .map(|one| (one.kind.as_str(), one.state.as_str()))
        .collect();
    let expected = [
        ("drift", "alerting"),
        ("tyre_pressure", "alerting"),
        ("not_applied", "suppressed"),
    ];
    assert_eq!(shown, expected);
    let json = serde_json::to_value(&documents[1]).unwrap();
    assert_eq!(
        (&json["kind"], &json["robot"]),
        (&"tyre_pressure".into(), &"c".into())
    );
    let active = store.active_alerts().await.unwrap();
    assert_eq!(active.len(), 1, "{active:?}");
    let id = stored[2].id();
    let (_, history) = store.alert(id).await.unwrap().unwrap();
    assert!(history.iter().all(|one| one.state.as_str() == "suppressed"));

    // This version changes neither, and evaluates the others.
    for (name, kind) in [("b", AlertKind::NotApplied), ("a", AlertKind::Drift)] {
        observe(&store, name, kind, Clear, 70).await;
    }
    for newer in &stored[1..] {
        let refused = acknowledge(&store, newer.id().0, newer.version()).await;
        assert!(matches!(
            refused,
            Err(StoreError::Alert(AlertRefused::Newer))
        ));
    }
    let after = store.alerts(&filter).await.unwrap();
    assert_eq!(after[1..], stored[1..]);
    assert_ne!(after[0], stored[0]);

    // A row that no version has written is an error.
    let broken = "UPDATE alert SET record = json_remove(record, '$.what') WHERE kind = 'drift'";
    database.execute(broken).await;
    let broken = store.alerts(&filter).await.unwrap_err();
    assert!(matches!(broken, StoreError::Corrupt { .. }), "{broken}");
}
