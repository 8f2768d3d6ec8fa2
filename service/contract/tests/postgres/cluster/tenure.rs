//! Jobs that an instance runs by itself, about a robot that may be another one's by now.

use async_trait::async_trait;
use fleetcal_cluster::Tenure;
use fleetcal_contract::{AddUser, IsThere};
use fleetcal_store::cluster::TakeForDead;
use fleetcal_store::{Job, Records, StoreError};
use tokio::time::timeout;

use super::instance::{Instance, MOMENT, database, end_lease};
use fleetcal_contract::own_server::Beside;

/// Adds a user on the strength of a tenure.
#[derive(Debug)]
struct AddUnder(Tenure, &'static str);

#[async_trait]
impl Job for AddUnder {
    type Done = ();

    async fn run(&self, records: &mut dyn Records) -> Result<(), StoreError> {
        // The snapshot is of this moment, and the tenure may end behind it.
        records.count_users().await?;
        if !records.holds_tenure(&self.0).await? {
            return Err(StoreError::Fenced(self.0.robot.clone()));
        }
        AddUser(self.1).run(records).await.map(drop)
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_job_of_an_ended_tenure_is_refused() {
    let (url, robots) = database(2).await;
    let a = Instance::join(&url, "a").await;
    let b = Instance::join(&url, "b").await;
    let tenures = a.claim(&robots, 1).await;
    let add = |name| a.store.transact(AddUnder(tenures[0].clone(), name));
    add("ann").await.unwrap();
    a.registry.free(&a.seat, &robots[..1]).await.unwrap();
    let refused = add("bob").await;
    assert!(matches!(&refused, Err(StoreError::Fenced(robot)) if *robot == robots[0]));
    // Again its own robot, in another tenure.
    a.claim(&robots[..1], 10).await;
    assert!(matches!(add("bob").await, Err(StoreError::Fenced(_))));
    end_lease(&url, "a");
    let taken = b.registry.take_for_dead(&b.seat, TakeForDead::LeaseEnded);
    assert_eq!(taken.await.unwrap(), std::slice::from_ref(&a.seat));
    let other = AddUnder(tenures[1].clone(), "bob");
    assert!(matches!(
        a.store.transact(other).await,
        Err(StoreError::Fenced(_))
    ));
    assert!(a.store.transact(IsThere("ann")).await.unwrap());
    assert!(!a.store.transact(IsThere("bob")).await.unwrap());
}

/// What the job read may be older than the end of the tenure: it is run again then.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_takeover_between_a_job_s_first_look_and_its_fence_is_seen() {
    let (url, robots) = database(1).await;
    let a = Instance::join(&url, "a").await;
    let b = Instance::join(&url, "b").await;
    let tenure = a.claim(&robots, 1).await.remove(0);
    // The job waits for its fence until this is over, with a snapshot of before.
    let hold = "BEGIN; SELECT FROM robot_owner FOR UPDATE";
    let mut holder = Beside::run(&url, hold);
    let job = a.store.transact(AddUnder(tenure, "ann"));
    let mut job = std::pin::pin!(job);
    assert!(timeout(MOMENT, &mut job).await.is_err(), "it waits");
    let free = "UPDATE robot_owner SET instance = NULL, incarnation = NULL, free_since_ns = 1";
    holder.go_on(&format!("{free}; COMMIT"));
    let refused = job.await;
    assert!(matches!(refused, Err(StoreError::Fenced(_))), "{refused:?}");
    assert_eq!(b.claim(&robots, 2).await.len(), 1);
    assert!(!a.store.transact(IsThere("ann")).await.unwrap());
}
