//! Answer of a robot about a document.

use fleetcal_model::{Generation, RevisionId, WallTime};
use fleetcal_proto::calibration::{Applied, AppliedStatus};

use super::ask::believable;
use super::deployment::{Deployment, DeploymentEvent, DeploymentState};
use super::draft::Draft;
use super::generation::{GenerationRef, InUse};
use super::ledger::OutboxEntry;
use super::refused::Refused;
use super::shadow::{Contradicted, Reported, Shadow};
use super::transition::{DeploymentAction, ShadowAction};

/// Largest lead of a robot's generation over the records: more than the calibrations approved
/// between two backups. A robot that names a higher one is not believed, so that it cannot exhaust
/// the numbers.
pub(super) const GENERATIONS_AHEAD_MAX: u64 = 1_000;

impl Draft<'_> {
    pub(super) fn acknowledge(&mut self, applied: &Applied) -> Result<(), Refused> {
        if let Some(values) = &applied.values {
            believable(values)?;
        }
        if applied.generation > self.outcome.ledger.shadow.generation_last {
            return self.heard_of_later(applied);
        }
        if let Some(live) = self.live_offer(applied.generation) {
            same_document(&live.offer, applied)?;
            return self.answer_to_offer(&live, applied);
        }
        let ledger = &self.outcome.ledger;
        let named = ledger.reference(applied.generation).cloned();
        if let Some(named) = &named {
            same_document(named, applied)?;
        }
        let desired = ledger.shadow.desired.as_ref();
        let is_desired = desired.is_some_and(|one| one.generation == applied.generation);
        // That an older one was refused, or dropped, is no news of a robot that uses a newer one.
        let uses_newer = |in_use: &InUse| in_use.generation > applied.generation;
        let is_old = ledger.shadow.in_use.as_ref().is_some_and(uses_newer);
        if is_old && !is_desired && applied.status != AppliedStatus::Applied {
            return Ok(());
        }
        // A robot that uses what is not wanted any more is not told to keep it: it goes back.
        let unwanted = applied.status == AppliedStatus::Applied
            && !applied.generation.is_factory()
            && !is_desired;
        self.report(applied, named.map(|one| one.revision), !unwanted);
        Ok(())
    }

    /// Records a generation that these records do not know: they are older than the robot, as after
    /// a backup was restored. The next approval must have a higher one, or the robot would refuse
    /// it as an old document.
    fn heard_of_later(&mut self, applied: &Applied) -> Result<(), Refused> {
        let last = self.outcome.ledger.shadow.generation_last;
        let most = Generation(last.0.saturating_add(GENERATIONS_AHEAD_MAX));
        if applied.generation > most {
            return Err(Refused::NeverOffered {
                generation: applied.generation,
                most,
            });
        }
        self.report(applied, None, false);
        Ok(())
    }

    /// Records the robot's answer to the present offer.
    fn answer_to_offer(&mut self, before: &Deployment, applied: &Applied) -> Result<(), Refused> {
        use DeploymentState as S;
        let (event, action) = match applied.status {
            AppliedStatus::Applied => (DeploymentEvent::Applied, DeploymentAction::Apply),
            AppliedStatus::Refused => (DeploymentEvent::Refused, DeploymentAction::Refuse),
            AppliedStatus::Failed => (DeploymentEvent::Failed, DeploymentAction::Fail),
            AppliedStatus::Reverted => (DeploymentEvent::Reverted, DeploymentAction::Revert),
        };
        let again =
            event == DeploymentEvent::Applied && matches!(before.state, S::Applied | S::Verifying);
        if !again {
            let mut live = before.clone();
            live.applied_ns = Some(self.standing.now);
            let reason = applied.reason.clone();
            self.advance(before, live, event, action, reason)?;
        }
        self.report(applied, Some(before.offer.revision), true);
        Ok(())
    }

    /// Records a robot's answer, and the calibration in use that follows from it.
    fn report(&mut self, applied: &Applied, revision: Option<RevisionId>, confirm: bool) {
        let generation = applied.generation;
        let now = self.standing.now;
        let mut shadow = self.outcome.ledger.shadow.clone();
        shadow.generation_last = shadow.generation_last.max(generation);
        if let Some(contradicted) = contradicts(&shadow, applied, now) {
            shadow.contradicted = Some(contradicted);
        }
        match applied.status {
            AppliedStatus::Applied => self.now_uses(&mut shadow, applied, revision),
            // It may have gone back from what it never told us that it used.
            AppliedStatus::Reverted if shadow.uses(generation) => {
                let before = shadow.before.take();
                let values = applied
                    .values
                    .or(before.as_ref().map(|before| before.values));
                shadow.in_use = values.map(|values| InUse {
                    generation: before
                        .as_ref()
                        .map_or(Generation::FACTORY, |before| before.generation),
                    revision: before.and_then(|before| before.revision),
                    values,
                    since_ns: applied.applied_at_ns,
                });
            }
            AppliedStatus::Reverted | AppliedStatus::Refused | AppliedStatus::Failed => {}
        }
        let reported = Reported {
            generation,
            sha256: applied.sha256.clone(),
            status: applied.status,
            reason: applied.reason.clone(),
            at_ns: applied.applied_at_ns,
            received_ns: now,
            confirmed: confirm,
        };
        let is_news = shadow.reported.as_ref().is_none_or(|last| {
            let received_ns = last.received_ns;
            *last
                != Reported {
                    received_ns,
                    ..reported.clone()
                }
        }) || shadow.in_use != self.outcome.ledger.shadow.in_use;
        // One confirmation waits at a time, and that of what is under way goes first.
        let live = self.outcome.ledger.live.as_ref();
        let another_waits = live.is_some_and(|live| {
            live.state == DeploymentState::Applied && live.offer.generation != generation
        });
        if confirm && !generation.is_factory() && !another_waits {
            self.outcome.outbox.push(OutboxEntry::Confirmed(generation));
        }
        // The same answer again, because its confirmation was lost, is no news.
        if is_news {
            shadow.reported = Some(reported);
            self.save_shadow(ShadowAction::Report, shadow, applied.reason.clone());
        }
    }

    /// Updates the calibration in use of a robot that has applied a document; unknown if no record
    /// has its values.
    fn now_uses(&self, shadow: &mut Shadow, applied: &Applied, revision: Option<RevisionId>) {
        let generation = applied.generation;
        let known = revision.and_then(|id| self.outcome.ledger.revisions.get(&id));
        let held = shadow.in_use.clone().filter(|_| shadow.uses(generation));
        if held.is_none() {
            shadow.before = shadow.in_use.take();
        }
        let values = applied.values.or(known.map(|revision| revision.values));
        let values = values.or(held.as_ref().map(|held| held.values));
        let revision = revision.or(held.and_then(|held| held.revision));
        shadow.in_use = values.map(|values| InUse {
            generation,
            revision: revision.filter(|_| !generation.is_factory()),
            values,
            since_ns: applied.applied_at_ns,
        });
    }
}

/// Contradiction between a robot's answer and the one before it, which cannot both be its own: it
/// refused, or could not use, what it was reported to have applied, or the other way round; it
/// applied that at another time; or it has been using since before what it was reported to have
/// replaced by its factory calibration.
fn contradicts(shadow: &Shadow, answer: &Applied, now: WallTime) -> Option<Contradicted> {
    use AppliedStatus as S;
    let before = shadow.reported.as_ref()?;
    let same = answer.generation == before.generation && !before.generation.is_factory();
    let goes_on = |earlier: &InUse| {
        earlier.generation == answer.generation && earlier.since_ns == answer.applied_at_ns
    };
    let cannot_be = match (before.status, answer.status) {
        (S::Applied, S::Refused | S::Failed) | (S::Refused | S::Failed, S::Applied) => same,
        (S::Applied, S::Applied) if same => answer.applied_at_ns != before.at_ns,
        (S::Applied, S::Applied) => {
            before.generation.is_factory()
                && !answer.generation.is_factory()
                && shadow.before.as_ref().is_some_and(goes_on)
        }
        _ => false,
    };
    cannot_be.then_some(Contradicted {
        generation: before.generation,
        status: before.status,
        received_ns: before.received_ns,
        by_generation: answer.generation,
        by_status: answer.status,
        at_ns: now,
    })
}

fn same_document(offer: &GenerationRef, applied: &Applied) -> Result<(), Refused> {
    if offer.sha256 != applied.sha256 {
        return Err(Refused::OtherDocument {
            generation: applied.generation,
            given: applied.sha256.clone(),
            found: offer.sha256.clone(),
        });
    }
    Ok(())
}
