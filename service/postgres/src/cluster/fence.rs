//! Fence of an instance's writes: its own robots' rows, and not one more.

use std::collections::{BTreeMap, BTreeSet};

use fleetcal_cluster::InstanceId;
use fleetcal_model::{RobotId, WallTime};
use fleetcal_store::StoreError;
use fleetcal_store::backend::Batch;

use super::robots::names;
use crate::connection::Session;

/// Locking of a fence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[doc(hidden)]
pub enum Fencing {
    /// The fence is locked, always so in a cluster.
    Locked,
    /// The fence is not locked: with this, the test of late writes shows that it can fail.
    Unlocked,
}

/// Fence that removes the rows of robots which another instance has taken over. A transaction of
/// telemetry first locks its instance's row, which is also locked to end one of its tenures, and
/// then reads its tenures: by a statement of its own, since a statement that waited for the lock
/// sees the state before it.
#[derive(Debug)]
pub(crate) struct Fence {
    instance: InstanceId,
    fencing: Fencing,
}

impl Fence {
    pub(crate) fn new(instance: InstanceId, fencing: Fencing) -> Self {
        Self { instance, fencing }
    }

    /// Removes the rows of ended tenures from a batch.
    ///
    /// # Errors
    /// The database's failure.
    pub(crate) async fn hold_back(
        &self,
        session: &mut Session,
        batch: &mut Batch,
    ) -> Result<(), StoreError> {
        const VALID: &str = "
            SELECT r.id FROM unnest($1::text[], $2::int8[]) AS t (id, claim)
            JOIN robot AS r USING (id)
            JOIN robot_owner AS o ON o.robot = r.key AND o.claim = t.claim
            WHERE o.instance = $3";
        if batch.claims.is_empty() {
            batch.retain(|_| false);
            return Ok(());
        }
        self.lock(session).await?;
        let claims: Vec<i64> = batch.claims.values().map(|claim| claim.0).collect();
        let query = sqlx::query_as(VALID)
            .bind(names(batch.claims.keys()))
            .bind(claims)
            .bind(self.instance.as_str());
        let valid: Vec<(String,)> = session.fetch(query).await.map_err(failed())?;
        if valid.len() < batch.claims.len() {
            let valid: BTreeSet<String> = valid.into_iter().map(|(name,)| name).collect();
            batch.retain(|robot| valid.contains(robot.as_str()));
        }
        Ok(())
    }

    /// Selects from these minutes, each with its robot's key, those of this instance's robots.
    ///
    /// # Errors
    /// The database's failure.
    pub(crate) async fn own_minutes(
        &self,
        session: &mut Session,
        minutes: &[(i64, i64)],
    ) -> Result<Vec<(i64, i64)>, StoreError> {
        const OWN: &str = "SELECT robot FROM robot_owner WHERE robot = ANY ($1) AND instance = $2";
        self.lock(session).await?;
        let robots: BTreeSet<i64> = minutes.iter().map(|(robot, _)| *robot).collect();
        let query = sqlx::query_as(OWN)
            .bind(robots.into_iter().collect::<Vec<_>>())
            .bind(self.instance.as_str());
        let own: Vec<(i64,)> = session.fetch(query).await.map_err(failed())?;
        let own: BTreeSet<i64> = own.into_iter().map(|(robot,)| robot).collect();
        let minutes = minutes.iter().copied();
        Ok(minutes.filter(|(robot, _)| own.contains(robot)).collect())
    }

    /// Returns the keys of this instance's robots among these, with the times of adoption.
    ///
    /// # Errors
    /// The database's failure.
    pub(crate) async fn own_robots(
        &self,
        session: &mut Session,
        robots: &BTreeMap<RobotId, WallTime>,
    ) -> Result<Vec<(i64, WallTime)>, StoreError> {
        const OWN: &str = "
            SELECT r.key, t.now FROM unnest($1::text[], $2::int8[]) AS t (id, now)
            JOIN robot AS r USING (id) JOIN robot_owner AS o ON o.robot = r.key
            WHERE o.instance = $3";
        self.lock(session).await?;
        let times: Vec<i64> = robots.values().map(|now| now.0).collect();
        let query = sqlx::query_as(OWN)
            .bind(names(robots.keys()))
            .bind(times)
            .bind(self.instance.as_str());
        let own: Vec<(i64, i64)> = session.fetch(query).await.map_err(failed())?;
        let own = own.into_iter();
        Ok(own.map(|(key, now)| (key, WallTime(now))).collect())
    }

    async fn lock(&self, session: &mut Session) -> Result<(), StoreError> {
        let locked = match self.fencing {
            Fencing::Locked => "SELECT 1::int8 FROM instance WHERE id = $1 FOR KEY SHARE",
            Fencing::Unlocked => "SELECT 1::int8 FROM instance WHERE id = $1",
        };
        let query = sqlx::query_as(locked).bind(self.instance.as_str());
        let locked: Result<Vec<(i64,)>, _> = session.fetch(query).await;
        locked.map(drop).map_err(failed())
    }
}

fn failed<E: std::error::Error + Send + Sync + 'static>() -> impl FnOnce(E) -> StoreError {
    StoreError::database("say which robots are this instance's")
}
