//! Retirement of a robot, and its return.

use super::command::Command;
use super::draft::Draft;
use super::ledger::RobotLedger;
use super::proposal::ProposalEvent;
use super::refused::Refused;
use super::shadow::Retirement;
use super::transition::ShadowAction;

/// Refuses commands on the records of a retired robot, except its return and what clears messages
/// that wait for it.
pub(super) fn admit(ledger: &RobotLedger, command: &Command) -> Result<(), Refused> {
    let clears = matches!(
        command,
        Command::BringBack { .. } | Command::Offered { .. } | Command::Confirmed { .. }
    );
    match &ledger.shadow.retired {
        Some(retired) if !clears => Err(Refused::Retired {
            by: retired.by.clone(),
        }),
        _ => Ok(()),
    }
}

impl Draft<'_> {
    /// Retires the robot. Its open proposal is withdrawn. A deployment that is under way has to end
    /// first, since nobody would learn of its outcome; and a robot that sends is at work.
    pub(super) fn retire(&mut self, reason: String) -> Result<(), Refused> {
        if let Some(live) = &self.outcome.ledger.live {
            return Err(Refused::UnderwayAtRetirement {
                deployment: live.id,
                state: live.state,
            });
        }
        if self.standing.is_sending {
            return Err(Refused::StillSends);
        }
        if let Some(open) = self.outcome.ledger.open.clone() {
            let withdrawn = ProposalEvent::Withdraw;
            self.close(open.id, None, withdrawn, Some(reason.clone()))?;
        }
        let mut shadow = self.outcome.ledger.shadow.clone();
        shadow.maintenance = None;
        shadow.retired = Some(Retirement {
            by: self.standing.actor.name.clone(),
            at_ns: self.standing.now,
            reason: reason.clone(),
        });
        self.save_shadow(ShadowAction::Retire, shadow, Some(reason));
        Ok(())
    }

    /// Brings a retired robot back.
    pub(super) fn bring_back(&mut self, reason: String) -> Result<(), Refused> {
        let mut shadow = self.outcome.ledger.shadow.clone();
        shadow.retired.take().ok_or(Refused::NotRetired)?;
        self.save_shadow(ShadowAction::BringBack, shadow, Some(reason));
        Ok(())
    }
}
