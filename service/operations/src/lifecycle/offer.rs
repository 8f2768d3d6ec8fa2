//! Delivery of approved calibrations to robots.

use fleetcal_domain::access::Actor;
use fleetcal_domain::approval::{
    Command, Deployment, DeploymentState, OutboxEntry, Refused, RobotLedger,
};
use std::time::Duration;

use fleetcal_model::Generation;
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::{ConfirmationDocument, ConfirmationSchema, Confirmed, Envelope};
use fleetcal_proto::offer::{OfferDocument, OfferSchema, Offered, Question};
use fleetcal_proto::signing::{Statement, sign};
use fleetcal_store::StoreError;

use super::Lifecycle;

/// Message for a robot, ready to be sent.
#[derive(Debug, Clone, PartialEq)]
pub enum OutboxMessage {
    /// Approved document.
    Approved(Box<Offered>),
    /// Confirmation that the robot's answer is stored.
    Confirmed(Confirmed),
}

impl Lifecycle {
    /// Document that a robot should use, with an offer that answers the robot's question. A
    /// document that was not offered yet is recorded as offered before it is sent.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn approved(
        &self,
        robot: &RobotId,
        question: Option<Question>,
    ) -> Result<Option<Offered>, StoreError> {
        let ledger = self.latest_ledger(robot).await?;
        let Some(mut generation) = self.shown(&ledger) else {
            return Ok(None);
        };
        if !self.offer(robot, &ledger, generation).await? {
            // The deployment freeze came first: the robot keeps what it was shown before.
            let live = ledger.live.as_ref();
            match live.and_then(|live| live.desired_before.as_ref()) {
                Some(before) => generation = before.generation,
                None => return Ok(None),
            }
        }
        let envelope = self.inner.store.envelope(robot, generation).await?;
        Ok(envelope.map(|envelope| self.offered(robot, generation, envelope, question)))
    }

    /// Signs an offer of a document. Its validity begins with each answer, so that a robot that was
    /// away for weeks gets a valid one.
    fn offered(
        &self,
        robot: &RobotId,
        generation: Generation,
        envelope: Envelope,
        question: Option<Question>,
    ) -> Offered {
        let now = self.inner.clock.now();
        let lasts = Duration::from_secs(self.policy().offer_valid_s.into());
        let offer = self.signed(&OfferDocument {
            schema: OfferSchema::V1,
            robot: robot.clone(),
            generation,
            sha256: envelope.sha256.clone(),
            offered_at_ns: now,
            valid_until_ns: now.plus(lasts),
            question,
        });
        let envelope = self.inner.keys.renewed(envelope);
        Offered { envelope, offer }
    }

    fn signed<T: Statement>(&self, statement: &T) -> Option<Envelope> {
        let signed = sign(statement, &self.inner.key);
        signed
            .inspect_err(|error| tracing::error!(%error, schema = T::SCHEMA, "not signed"))
            .ok()
    }

    /// Document that a robot should use, for other callers: reading it makes no offer.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn desired(&self, robot: &RobotId) -> Result<Option<Envelope>, StoreError> {
        let ledger = self.ledger(robot);
        let Some(desired) = &ledger.shadow.desired else {
            return Ok(None);
        };
        let envelope = self.inner.store.envelope(robot, desired.generation).await?;
        Ok(envelope.map(|envelope| self.inner.keys.renewed(envelope)))
    }

    /// Confirmation of a robot's latest stored answer, for a robot that requests it.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn latest_confirmed(&self, robot: &RobotId) -> Result<Option<Confirmed>, StoreError> {
        self.latest_ledger(robot).await?;
        Ok(self.confirmed(robot))
    }

    /// Confirmation of a robot's latest answer by the records of this process.
    pub fn confirmed(&self, robot: &RobotId) -> Option<Confirmed> {
        let ledger = self.ledger(robot);
        let reported = ledger.shadow.reported.as_ref()?;
        (reported.confirmed && !reported.generation.is_factory()).then(|| Confirmed {
            generation: reported.generation,
            sha256: reported.sha256.clone(),
            signed: self.signed(&ConfirmationDocument {
                schema: ConfirmationSchema::V1,
                robot: robot.clone(),
                generation: reported.generation,
                sha256: reported.sha256.clone(),
                status: reported.status,
                applied_at_ns: reported.at_ns,
            }),
        })
    }

    /// Waits until a message is to be sent.
    pub async fn post_comes(&self) {
        self.inner.outbox.notified().await;
    }

    /// Messages to be sent, including those that the deployment freeze holds.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn outbox(&self) -> Result<Vec<(RobotId, OutboxEntry)>, StoreError> {
        self.inner.store.outbox().await
    }

    /// Prepares a message for an entry of the outbox. `None` if the deployment freeze holds it, or
    /// a newer one has replaced it. `None` when it is held, or when something newer has taken its
    /// place.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn message(
        &self,
        robot: &RobotId,
        entry: OutboxEntry,
    ) -> Result<Option<OutboxMessage>, StoreError> {
        // The entry is read from the store, which knows of a decision before the lock does.
        drop(self.lock(robot).turn.lock().await);
        let ledger = self.ledger(robot);
        match entry {
            OutboxEntry::Approved(generation) => {
                if self.shown(&ledger) != Some(generation) {
                    if !self.is_held(&ledger) {
                        self.sent(robot, entry).await?;
                    }
                    return Ok(None);
                }
                if !self.offer(robot, &ledger, generation).await? {
                    return Ok(None);
                }
                let envelope = self.inner.store.envelope(robot, generation).await?;
                let offered = |envelope| self.offered(robot, generation, envelope, None);
                Ok(envelope.map(|envelope| OutboxMessage::Approved(Box::new(offered(envelope)))))
            }
            OutboxEntry::Confirmed(generation) => {
                let confirmed = self.confirmed(robot);
                let confirmed = confirmed.filter(|one| one.generation == generation);
                if confirmed.is_none() {
                    self.sent(robot, entry).await?;
                }
                Ok(confirmed.map(OutboxMessage::Confirmed))
            }
        }
    }

    /// Records that an entry was sent.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn sent(&self, robot: &RobotId, entry: OutboxEntry) -> Result<(), StoreError> {
        let command = match entry {
            OutboxEntry::Approved(generation) => Command::Offered { generation },
            OutboxEntry::Confirmed(generation) => Command::Confirmed { generation },
        };
        let decided = self.decide(robot, command, Actor::service(), None).await;
        decided.map(|_| ())
    }

    /// Records a document as offered; returns true if the robot may receive it. The deployment
    /// freeze is read again in the transaction, since it may have begun after the check that led
    /// here.
    async fn offer(
        &self,
        robot: &RobotId,
        ledger: &RobotLedger,
        generation: Generation,
    ) -> Result<bool, StoreError> {
        let is_new = ledger.live.as_ref().is_some_and(|live| {
            live.state == DeploymentState::Queued && live.offer.generation == generation
        });
        if !is_new {
            return Ok(true);
        }
        let command = Command::Offer { generation };
        match self.decide(robot, command, Actor::service(), None).await {
            Ok(_) => Ok(true),
            Err(StoreError::Refused(Refused::Held(_))) => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// Generation that a robot may receive.
    fn shown(&self, ledger: &RobotLedger) -> Option<Generation> {
        let desired = if self.is_held(ledger) {
            let live = ledger.live.as_ref();
            live.and_then(|live| live.desired_before.as_ref())
        } else {
            ledger.shadow.desired.as_ref()
        };
        desired.map(|desired| desired.generation)
    }

    /// True if the deployment freeze holds a robot's deployment. A roll-back is never held.
    fn is_held(&self, ledger: &RobotLedger) -> bool {
        let keeps = |live: &Deployment| {
            live.proposal.is_some()
                && matches!(
                    live.state,
                    DeploymentState::Queued | DeploymentState::Offered
                )
        };
        self.deployment_freeze().frozen && ledger.live.as_ref().is_some_and(keeps)
    }
}
