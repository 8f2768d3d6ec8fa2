//! Due commands of the lifecycle, each second.

use std::time::Duration;

use fleetcal_domain::access::Actor;
use fleetcal_domain::approval::{Command, Objections, Situation, automatic, due, nominal_values};
use fleetcal_domain::robot::{RobotState, RobotView, WarningKind};
use fleetcal_model::WallTime;
use fleetcal_store::StoreError;
use tokio::time::MissedTickBehavior;

use super::Lifecycle;
use super::rollout_duty::Looked;
use crate::notes;

/// Interval of the checks of the records.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// Checks every robot's records until the lifecycle stops.
pub(super) async fn attend(lifecycle: Lifecycle) {
    let mut ticks = tokio::time::interval(LOOK_EVERY);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut looked = Looked::default();
    loop {
        tokio::select! {
            () = lifecycle.inner.stop.cancelled() => return,
            _ = ticks.tick() => {}
        }
        lifecycle.look().await;
        lifecycle.look_at_rollouts(&mut looked).await;
    }
}

impl Lifecycle {
    /// Checks every robot's records once, and applies due commands.
    pub(super) async fn look(&self) {
        let now = self.inner.clock.now();
        let membership = &self.inner.membership;
        for view in self.inner.fleet.robots() {
            if !membership.has(&view.id) || !membership.may_act(self.inner.clock.uptime()) {
                continue;
            }
            if self.inner.fleet.wants_notes(&view.id)
                && let Err(error) =
                    notes::bring(&self.inner.store, &self.inner.fleet, &view.id).await
            {
                self.inner.fleet.want_notes(&view.id);
                tracing::error!(robot.id = %view.id, %error, "notes cannot be passed on");
            }
            let Some(command) = self.due(&view, now) else {
                continue;
            };
            let done = self.decide(&view.id, command, Actor::service(), None).await;
            match done {
                Ok(_) => {}
                // Somebody was faster; the next look sees what is due then.
                Err(refused @ (StoreError::Refused(_) | StoreError::Fenced(_))) => {
                    tracing::debug!(robot.id = %view.id, %refused, "a due command does not fit");
                }
                Err(error) => {
                    tracing::error!(robot.id = %view.id, %error, "a due command failed");
                }
            }
        }
    }

    fn due(&self, view: &RobotView, now: WallTime) -> Option<Command> {
        let config = view.config.as_ref()?;
        let ledger = self.ledger(&view.id);
        let policy = self.policy();
        let calibrated = view.state == RobotState::Calibrated;
        let estimate = view.estimate.as_deref().filter(|_| calibrated);
        let stable = self.inner.fleet.has_stable_estimate(&view.id, &policy);
        let verification = view.verification.as_ref();
        let in_use = ledger
            .shadow
            .in_use
            .as_ref()
            .map(|in_use| in_use.generation);
        let verification = verification.filter(|(generation, _)| Some(*generation) == in_use);
        let situation = Situation {
            now,
            estimate,
            objections: Objections {
                reassembly_open: view.reassembly_open,
                two_senders: view.is_warned(WarningKind::TwoSenders),
                vehicle_changed: view.state == RobotState::Changed,
            },
            stable,
            verification: verification.map(|(_, estimate)| estimate.as_ref()),
            nominal: config
                .nominal_extrinsics
                .map(|mount| nominal_values(&mount.pose())),
        };
        due(&ledger, &situation, &policy).or_else(|| automatic(&ledger, &policy))
    }
}
