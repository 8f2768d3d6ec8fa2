//! Jobs that an instance runs by itself, on the strength of a robot or of a duty that may be another
//! one's by now.

use async_trait::async_trait;
use fleetcal_cluster::{Duty, Seat, Tenure};
use fleetcal_contract::{AddUser, IsThere};
use fleetcal_store::cluster::TakeForDead;
use fleetcal_store::{Job, Records, StoreError};
use tokio::time::timeout;

use super::instance::{Instance, MOMENT, database, end_lease};
use fleetcal_contract::own_server::Beside;

/// Job that adds a user under a tenure.
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

/// Job that adds a user under a duty.
#[derive(Debug)]
struct AddOnDuty(Seat, &'static str);

#[async_trait]
impl Job for AddOnDuty {
    type Done = bool;

    async fn run(&self, records: &mut dyn Records) -> Result<bool, StoreError> {
        // The snapshot is of this moment, and the duty may go behind it.
        records.count_users().await?;
        let held = records.holds_duty(&self.0, Duty::Alerts).await?;
        if held {
            AddUser(self.1).run(records).await?;
        }
        Ok(held)
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_job_of_a_duty_that_has_gone_is_not_done() {
    let (url, _) = database(1).await;
    let a = Instance::join(&url, "a").await;
    let b = Instance::join(&url, "b").await;
    let alerts = [Duty::Alerts];
    let claim = |one: &Instance| {
        let (registry, seat) = (one.registry.clone(), one.seat.clone());
        async move { registry.claim_duties(&seat, &alerts).await.unwrap() }
    };
    assert_eq!(claim(&a).await, alerts);
    let add = |of: &Instance, name| a.store.transact(AddOnDuty(of.seat.clone(), name));
    assert!(add(&a, "ann").await.unwrap());
    assert!(!add(&b, "bob").await.unwrap());
    // The duty goes while the job waits for its fence, with a snapshot of before.
    let mut holder = Beside::run(&url, "BEGIN; SELECT FROM duty FOR UPDATE");
    let job = add(&a, "bob");
    let mut job = std::pin::pin!(job);
    assert!(timeout(MOMENT, &mut job).await.is_err(), "it waits");
    let free = "UPDATE duty SET instance = NULL, incarnation = NULL, free_since_ns = 1";
    holder.go_on(&format!("{free}; COMMIT"));
    assert!(!job.await.unwrap());
    assert_eq!(claim(&b).await, alerts);
    assert!(!a.store.transact(IsThere("bob")).await.unwrap());
}

/// Checks that a duty does not move to another instance while one of its jobs runs.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_duty_waits_for_what_is_written_on_its_strength() {
    let (url, _) = database(1).await;
    let a = Instance::join(&url, "a").await;
    let b = Instance::join(&url, "b").await;
    let alerts = [Duty::Alerts];
    let claimed = a.registry.claim_duties(&a.seat, &alerts).await.unwrap();
    assert_eq!(claimed, alerts);
    let mut job = Beside::run(&url, "BEGIN; SELECT FROM duty FOR SHARE");
    end_lease(&url, "a");
    let taken = b.registry.take_for_dead(&b.seat, TakeForDead::LeaseEnded);
    let mut taken = std::pin::pin!(taken);
    assert!(timeout(MOMENT, &mut taken).await.is_err(), "it waits");
    job.go_on("COMMIT");
    assert_eq!(taken.await.unwrap(), std::slice::from_ref(&a.seat));
    let claimed = b.registry.claim_duties(&b.seat, &alerts).await.unwrap();
    assert_eq!(claimed, alerts);
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

/// Checks that a job whose reads may be older than the end of the tenure is run again.
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
