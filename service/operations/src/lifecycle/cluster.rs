//! Lifecycle beside other instances that decide as well.

use std::sync::{Arc, PoisonError};

use fleetcal_cluster::Tenure;
use fleetcal_domain::access::{Actor, Authentication};
use fleetcal_domain::approval::{Command, RobotLedger};
use fleetcal_fleet::live::LiveUpdate;
use fleetcal_proto::RobotId;
use fleetcal_store::StoreError;

use super::Lifecycle;
use super::decide::Release;

impl Lifecycle {
    /// Reads again the records of robots that another instance has changed.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn reload(&self, robots: &[RobotId]) -> Result<(), StoreError> {
        for robot in robots {
            let lock = self.lock(robot);
            // Not between a decision of this instance and what follows from it.
            let _turn = lock.turn.lock().await;
            let ledger = Arc::new(self.inner.store.load_ledger(robot).await?);
            let mut known = lock.ledger.write().unwrap_or_else(PoisonError::into_inner);
            if *known == ledger {
                continue;
            }
            known.clone_from(&ledger);
            drop(known);
            self.tell_fleet(&ledger);
            self.inner.fleet.announce(LiveUpdate::Approval {
                robot: robot.clone(),
            });
        }
        if !robots.is_empty() {
            self.inner.outbox.notify_one();
        }
        Ok(())
    }

    /// Passes the calibration in use to a robot's task that has just begun.
    pub fn tell_fleet_again(&self, robot: &RobotId) {
        self.tell_fleet(&self.ledger(robot));
    }

    /// Reads again the deployment freeze, which another instance has changed.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn reload_freeze(&self) -> Result<(), StoreError> {
        let freeze = self.inner.store.deployment_freeze().await?;
        let known = self.inner.freeze.write();
        let mut known = known.unwrap_or_else(PoisonError::into_inner);
        if known.version < freeze.version {
            *known = freeze;
            drop(known);
            self.inner.outbox.notify_one();
            self.inner.fleet.announce(LiveUpdate::Freeze);
        }
        Ok(())
    }

    /// Reads again the policy, which another instance has changed.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn reload_policy(&self) -> Result<(), StoreError> {
        let policy = self.inner.store.stored_policy().await?;
        if self.inner.rules.take(policy) {
            self.inner.fleet.announce(LiveUpdate::Policy);
        }
        Ok(())
    }

    /// Records of a robot as the database has them at this moment; for a single service, as it has
    /// them in memory.
    ///
    /// # Errors
    /// The database's failure.
    pub(super) async fn latest_ledger(
        &self,
        robot: &RobotId,
    ) -> Result<Arc<RobotLedger>, StoreError> {
        if self.inner.membership.cluster().is_some() {
            self.reload(std::slice::from_ref(robot)).await?;
        }
        Ok(self.ledger(robot))
    }

    /// Tenure that a command needs. The service's own decisions and releases are the owner's part,
    /// except answers to a robot's request: any instance has them.
    pub(super) fn tenure_for(
        &self,
        robot: &RobotId,
        command: &Command,
        (actor, release): (&Actor, Option<Release>),
    ) -> Result<Option<Tenure>, StoreError> {
        let is_own = (actor.authentication == Authentication::Service || release.is_some())
            && !matches!(command, Command::Offer { .. });
        if !is_own || self.inner.membership.cluster().is_none() {
            return Ok(None);
        }
        let tenure = self.inner.membership.tenure(robot);
        tenure
            .map(Some)
            .ok_or_else(|| StoreError::Fenced(robot.clone()))
    }
}
