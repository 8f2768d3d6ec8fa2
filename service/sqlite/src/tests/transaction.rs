//! Transactions of SQLite with several jobs.

use fleetcal_contract::{AddUser, IsThere};
use fleetcal_domain::access::Actor;
use fleetcal_domain::approval::DeploymentAction;
use fleetcal_domain::audit::Action;
use fleetcal_model::{UserId, WallTime};
use fleetcal_store::{AuditEntry, Job, Records, StoreError};

use super::durability::raw;
use super::*;

#[tokio::test]
async fn jobs_that_wait_share_a_transaction() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(folder.path(), &clock()).await;
    // One thread: both of them wait before the first one runs.
    let (added, found) = tokio::join!(
        store.transact(AddUser("ann")),
        store.transact(IsThere("ann")),
    );
    assert_eq!((added.unwrap(), found.unwrap()), (UserId(1), true));
    assert_eq!(store.counters().commits, 1);
}

/// Appends a row to the audit.
#[derive(Debug)]
struct Append;

#[async_trait::async_trait]
impl Job for Append {
    type Done = ();

    async fn run(&self, records: &mut dyn Records) -> Result<(), StoreError> {
        let entry = AuditEntry {
            at_ns: WallTime(7),
            actor: Actor::service(),
            action: Action::Deployment(DeploymentAction::Offer),
            subject_id: "1".to_owned(),
            robot: None,
            before: None,
            after: Some(serde_json::json!({ "state": "offered" })),
            reason: None,
        };
        records.append_audit(&entry).await
    }
}

#[tokio::test]
async fn an_audit_row_is_never_changed_and_never_deleted() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(folder.path(), &clock()).await;
    store.transact(Append).await.unwrap();
    store.close().await.unwrap();
    let mut connection = raw(folder.path()).await;
    for sql in ["UPDATE audit SET actor = 'x'", "DELETE FROM audit"] {
        let refused = sqlx::query(sql).execute(&mut connection).await.unwrap_err();
        assert!(refused.to_string().contains("never"), "{refused}");
    }
}
