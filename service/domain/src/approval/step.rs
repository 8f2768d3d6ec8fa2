//! Step: applies a command to a robot's records, or refuses it.

use fleetcal_model::{DeploymentId, Generation, WallTime};

use super::command::{Command, Standing};
use super::deployment::{DeploymentEvent, DeploymentState, Verification};
use super::draft::{Draft, fresh};
use super::ledger::{NextIds, OutboxEntry, Outcome, RobotLedger};
use super::proposal::ProposalEvent;
use super::refused::Refused;
use super::retirement::admit;
use super::rollback::Rollback;
use super::shadow::{Maintenance, Shadow};
use super::transition::{DeploymentAction, ShadowAction};

/// Applies a command to a robot's records.
///
/// # Errors
/// If it does not fit them; nothing has changed then.
pub fn step(
    ledger: &RobotLedger,
    command: Command,
    ids: NextIds,
    standing: &Standing<'_>,
) -> Result<Outcome, Refused> {
    admit(ledger, &command)?;
    let mut draft = Draft::new(ledger, ids, standing);
    match command {
        Command::Propose {
            origin,
            values,
            sigmas,
            evidence,
            reason,
        } => draft.propose(origin, (values, sigmas), evidence, reason)?,
        Command::Approve {
            proposal,
            version,
            sha256,
            reason,
        } => draft.approve(proposal, version, sha256, reason)?,
        Command::Reject {
            proposal,
            version,
            reason,
        } => {
            let reason = said(reason)?;
            draft.close(proposal, version, ProposalEvent::Reject, Some(reason))?;
        }
        Command::Withdraw {
            proposal,
            version,
            reason,
        } => draft.close(proposal, version, ProposalEvent::Withdraw, reason)?,
        Command::Expire { proposal } => {
            draft.close(proposal, None, ProposalEvent::Expire, None)?;
        }
        Command::Supersede { proposal, reason } => {
            draft.close(proposal, None, ProposalEvent::Supersede, Some(reason))?;
        }
        Command::Refresh {
            proposal,
            values,
            sigmas,
            evidence,
            reason,
        } => draft.refresh(proposal, (values, sigmas), evidence, &reason)?,
        Command::Offer { generation } => draft.offer(generation)?,
        Command::Offered { generation } => {
            draft.offered(generation);
        }
        Command::Acknowledge(applied) => draft.acknowledge(&applied)?,
        Command::Confirmed { generation } => draft.confirmed(generation)?,
        Command::Judge {
            deployment,
            verification,
        } => draft.judge(deployment, &verification)?,
        Command::GiveUp { deployment, reason } => draft.give_up(deployment, reason)?,
        Command::Void { deployment, reason } => draft.void(deployment, reason)?,
        Command::Maintain { until_ns, reason } => draft.maintain(until_ns, said(reason)?)?,
        Command::Retire { reason } => draft.retire(said(reason)?)?,
        Command::BringBack { reason } => draft.bring_back(said(reason)?)?,
        Command::RollBack { version, reason } => {
            let found = draft.outcome.ledger.shadow.version;
            fresh(version, found)?;
            draft.automatic_sum = Some([0.0; 4]);
            draft.roll_back(Rollback::ByPerson, said(reason)?)?;
        }
    }
    draft.outcome.ledger.answered = None;
    Ok(draft.outcome)
}

impl Draft<'_> {
    /// Moves the deployment to `Offered`, as its document is about to be sent.
    fn offer(&mut self, generation: Generation) -> Result<(), Refused> {
        let Some(before) = self.live_offer(generation) else {
            return Ok(());
        };
        if before.state == DeploymentState::Queued {
            // The way back is never kept.
            if self.standing.frozen && before.proposal.is_some() {
                return Err(Refused::Held(before.id));
            }
            let mut live = before.clone();
            live.offered_ns = Some(self.standing.now);
            self.advance(
                &before,
                live,
                DeploymentEvent::Offer,
                DeploymentAction::Offer,
                None,
            )?;
        }
        Ok(())
    }

    /// Removes the sent document from the outbox. The document of a deployment that is still queued
    /// stays there.
    fn offered(&mut self, generation: Generation) {
        let live = self.live_offer(generation);
        if live.is_none_or(|live| live.state != DeploymentState::Queued) {
            self.outcome.sent = Some(OutboxEntry::Approved(generation));
        }
    }

    /// Records that the confirmation was sent to the robot.
    fn confirmed(&mut self, generation: Generation) -> Result<(), Refused> {
        self.outcome.sent = Some(OutboxEntry::Confirmed(generation));
        let Some(before) = self.live_offer(generation) else {
            return Ok(());
        };
        if before.state == DeploymentState::Applied {
            let event = DeploymentEvent::Confirmed;
            self.advance(
                &before,
                before.clone(),
                event,
                DeploymentAction::Confirm,
                None,
            )?;
        }
        Ok(())
    }

    fn judge(&mut self, id: DeploymentId, verification: &Verification) -> Result<(), Refused> {
        let before = self.underway(id)?;
        let mut live = before.clone();
        live.verification = Some(verification.clone());
        if verification.within {
            live.reason = None;
            let event = DeploymentEvent::Verified;
            self.advance(&before, live, event, DeploymentAction::Verify, None)?;
            let mut shadow = self.outcome.ledger.shadow.clone();
            shadow.verified.push(before.offer);
            let surplus = shadow.verified.len().saturating_sub(Shadow::VERIFIED_MAX);
            shadow.verified.drain(..surplus);
            self.save_shadow(ShadowAction::Remember, shadow, None);
            return Ok(());
        }
        if before.is_return() {
            let by = &before.approved_by;
            let reason =
                format!("a verification estimate disagrees with the values that {by} chose");
            let event = DeploymentEvent::Contradicted;
            return self.advance(&before, live, event, DeploymentAction::Keep, Some(reason));
        }
        let reason = "a verification estimate disagrees with what the robot uses".to_owned();
        // The verdict is written down before what follows from it.
        let event = DeploymentEvent::VerificationFailed;
        let action = DeploymentAction::FailVerification;
        self.advance(&before, live, event, action, Some(reason.clone()))?;
        if !self.standing.policy.roll_back {
            return Ok(());
        }
        match self.roll_back(Rollback::Automatic, reason) {
            // Somebody has to decide what the robot shall use instead.
            Err(Refused::NothingToReturnTo) => Ok(()),
            other => other,
        }
    }

    fn give_up(&mut self, id: DeploymentId, reason: String) -> Result<(), Refused> {
        let before = self.underway(id)?;
        let (event, action) = match before.state {
            DeploymentState::Verifying => (
                DeploymentEvent::TooLittleMotion,
                DeploymentAction::LeaveInconclusive,
            ),
            _ => (DeploymentEvent::TimeOut, DeploymentAction::TimeOut),
        };
        self.advance(&before, before.clone(), event, action, Some(reason))
    }

    fn void(&mut self, id: DeploymentId, reason: String) -> Result<(), Refused> {
        let before = self.underway(id)?;
        if before.is_return() {
            return Err(Refused::ChosenByPerson {
                generation: before.offer.generation,
                by: before.approved_by,
            });
        }
        match before.state {
            DeploymentState::Queued | DeploymentState::Offered => {
                self.roll_back(Rollback::Automatic, reason)
            }
            state => Err(Refused::Deployment {
                state,
                event: DeploymentEvent::RollBack,
            }),
        }
    }
}

impl Draft<'_> {
    /// Begins maintenance of a robot that is switched off on purpose, or ends it.
    fn maintain(&mut self, until_ns: Option<WallTime>, reason: String) -> Result<(), Refused> {
        let now = self.standing.now;
        let mut shadow = self.outcome.ledger.shadow.clone();
        let Some(until_ns) = until_ns else {
            let held = shadow.maintenance.take();
            held.filter(|held| held.holds_at(now))
                .ok_or(Refused::NoMaintenance)?;
            self.save_shadow(ShadowAction::EndMaintenance, shadow, Some(reason));
            return Ok(());
        };
        let lasts_ns = until_ns.ns_since(now);
        if !(1..=Maintenance::LONGEST_NS).contains(&lasts_ns) {
            return Err(Refused::OutOfLimits {
                field: "until",
                value: lasts_ns as f64 / 3.6e12,
                accepted: "more than 0 and at most 2160 hours from now".to_owned(),
            });
        }
        shadow.maintenance = Some(Maintenance {
            until_ns,
            by: self.standing.actor.name.clone(),
            at_ns: now,
            reason: reason.clone(),
        });
        self.save_shadow(ShadowAction::BeginMaintenance, shadow, Some(reason));
        Ok(())
    }
}

fn said(reason: String) -> Result<String, Refused> {
    if reason.trim().is_empty() {
        return Err(Refused::ReasonMissing);
    }
    Ok(reason)
}
