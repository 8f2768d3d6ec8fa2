//! Two stores that decide on one record of one database.

use async_trait::async_trait;
use fleetcal_contract::{TestDatabase, clock};
use fleetcal_domain::approval::{NextIds, Refused};
use fleetcal_model::{Version, WallTime};
use fleetcal_store::{DeploymentFreeze, Job, Records, Store, StoreError};

use crate::differential::lifecycle::propose;
use fleetcal_contract::own_server::{named, number};

/// Job that freezes or thaws, if the freeze is unchanged since `expected`.
#[derive(Debug)]
struct Freeze {
    expected: Version,
    by: &'static str,
}

#[async_trait]
impl Job for Freeze {
    type Done = ();

    async fn run(&self, records: &mut dyn Records) -> Result<(), StoreError> {
        let found = records.deployment_freeze().await?;
        if found.version != self.expected {
            let found = found.version;
            return Err(Refused::Stale { found }.into());
        }
        let freeze = DeploymentFreeze {
            version: found.version.next(),
            frozen: !found.frozen,
            by: Some(self.by.to_owned()),
            at_ns: Some(WallTime(5)),
            reason: None,
        };
        records.save_deployment_freeze(&freeze).await
    }
}

/// Job that proposes a new revision for a robot of its own.
#[derive(Debug)]
struct Propose {
    robot: String,
}

#[async_trait]
impl Job for Propose {
    type Done = NextIds;

    async fn run(&self, records: &mut dyn Records) -> Result<NextIds, StoreError> {
        let robot = fleetcal_contract::robot(&self.robot);
        let ledger = records.ledger(&robot, None).await?;
        let ids = records.next_ids().await?;
        records.save_outcome(&propose(ledger, ids, 7)).await?;
        Ok(ids)
    }
}

/// Opens two stores on one new database.
async fn two_stores() -> (Store, Store) {
    let database = TestDatabase::on(&named()).await;
    (database.open(clock()).await, database.open(clock()).await)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn of_two_stores_exactly_one_decides() {
    let rounds = number("CONTRACT_RACES", 300);
    let (ann, bob) = two_stores().await;
    let mut won_by_ann = 0;
    for round in 0..rounds {
        let expected = ann.deployment_freeze().await.unwrap().version;
        let freeze = |by| Freeze { expected, by };
        let (ann_told, bob_told) =
            tokio::join!(ann.transact(freeze("ann")), bob.transact(freeze("bob")),);
        let is_stale = |told: &Result<(), StoreError>| {
            matches!(told, Err(StoreError::Refused(Refused::Stale { .. })))
        };
        let winner = match (&ann_told, &bob_told) {
            (Ok(()), refused) if is_stale(refused) => "ann",
            (refused, Ok(())) if is_stale(refused) => "bob",
            other => panic!("round {round}: {other:?}"),
        };
        won_by_ann += usize::from(winner == "ann");
        for store in [&ann, &bob] {
            let found = store.deployment_freeze().await.unwrap();
            assert_eq!(found.version, expected.next());
            assert_eq!(found.by.as_deref(), Some(winner));
        }
    }
    println!("{rounds} races, {won_by_ann} won by the first store");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn two_stores_never_give_out_the_same_numbers() {
    let rounds = number("CONTRACT_RACES", 300) / 3;
    let (ann, bob) = two_stores().await;
    let mut last = 0;
    for round in 0..rounds {
        let propose = |name| Propose {
            robot: format!("{name}{round}"),
        };
        let (of_ann, of_bob) =
            tokio::join!(ann.transact(propose("ann")), bob.transact(propose("bob")));
        let mut given = [of_ann.unwrap(), of_bob.unwrap()].map(|ids| ids.proposal.0);
        given.sort_unstable();
        assert_eq!(given, [last + 1, last + 2]);
        last += 2;
    }
}
