//! An instance as a test has it: its store, and its life.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use fleetcal_cluster::{ClaimId, Seat, Tenure};
use fleetcal_contract::{NOW_S, NS, clock, config, joining, open_instance, robot};
use fleetcal_model::{RobotId, Version, WallTime};
use fleetcal_postgres::Fencing;
use fleetcal_store::cluster::{ClusterRegistry, Look, Renewal};
use fleetcal_store::database_url::PostgresUrl;
use fleetcal_store::{Job, Records, Store, StoreError};

use fleetcal_contract::own_server::{named, psql, setup};

/// An instance that has joined.
#[derive(Debug)]
pub struct Instance {
    pub store: Store,
    pub registry: Arc<dyn ClusterRegistry>,
    pub seat: Seat,
}

impl Instance {
    /// Makes an instance of this name, which has joined.
    pub async fn join(url: &PostgresUrl, name: &str) -> Self {
        Self::join_with(url, name, Fencing::Locked).await
    }

    /// Makes an instance likewise, with a fence that may be broken.
    pub async fn join_with(url: &PostgresUrl, name: &str, fencing: Fencing) -> Self {
        let store = open_instance(setup(url), name, fencing).await.unwrap();
        let registry = store.registry().unwrap();
        let seat = registry.join(&joining(name)).await.unwrap();
        let instance = Self {
            store,
            registry,
            seat,
        };
        assert!(instance.renew().await);
        instance
    }

    /// True if a renewal is granted.
    pub async fn renew(&self) -> bool {
        let renewal = Renewal {
            linked: true,
            ..Renewal::default()
        };
        let renewed = self.registry.renew(&self.seat, renewal).await.unwrap();
        renewed.is_some()
    }

    /// Reads the rows.
    pub async fn look(&self) -> Look {
        self.registry.look(None).await.unwrap()
    }

    /// Claims robots and records the tenures that it got; claims are numbered from `first` on.
    pub async fn claim(&self, robots: &[RobotId], first: i64) -> Vec<Tenure> {
        let numbered = robots.iter().cloned().zip((first..).map(ClaimId));
        let wanted: Vec<_> = numbered.collect();
        let tenures = self.registry.claim(&self.seat, &wanted).await.unwrap();
        for tenure in &tenures {
            self.store.claims().set(tenure);
        }
        tenures
    }

    /// Returns its robots by the rows.
    pub async fn robots(&self) -> BTreeSet<RobotId> {
        let rows = self.look().await.snapshot.robots.into_iter();
        rows.filter(|(_, row)| row.owner.as_ref() == Some(&self.seat))
            .map(|(robot, _)| robot)
            .collect()
    }
}

/// Job that stores the configurations of robots.
#[derive(Debug)]
struct KeepRobots(Vec<RobotId>);

#[async_trait::async_trait]
impl Job for KeepRobots {
    type Done = ();

    async fn run(&self, records: &mut dyn Records) -> Result<(), StoreError> {
        let now = WallTime(NOW_S * NS);
        for robot in &self.0 {
            records
                .save_config(robot, &config(1.2), None, Version(1), now)
                .await?;
        }
        Ok(())
    }
}

/// Makes a database with this number of robots; returns their ids, `robot_000` first.
pub async fn database(robots: usize) -> (PostgresUrl, Vec<RobotId>) {
    let url = fleetcal_postgres::create_for_test(&named()).await.unwrap();
    (url.clone(), fill(&url, robots).await)
}

/// Makes this number of robots in a database.
pub async fn fill(url: &PostgresUrl, robots: usize) -> Vec<RobotId> {
    let store = fleetcal_postgres::open(setup(url), Box::new(()), clock() as _)
        .await
        .unwrap();
    let robots: Vec<_> = (0..robots)
        .map(|number| robot(&format!("robot_{number:03}")))
        .collect();
    store.transact(KeepRobots(robots.clone())).await.unwrap();
    store.close().await.unwrap();
    robots
}

/// Ends the lease of an instance now.
pub fn end_lease(url: &PostgresUrl, name: &str) {
    let sql = format!("UPDATE instance SET lease_ends_ns = clock_ns() - 1 WHERE id = '{name}'");
    psql(url, &sql);
}

/// Time after which a wait that fails to happen would be noticed.
pub const MOMENT: Duration = Duration::from_millis(300);
