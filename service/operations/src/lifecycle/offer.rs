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

/// Something for a robot, ready to be put on the wire.
#[derive(Debug, Clone, PartialEq)]
pub enum OutboxMessage {
    /// The approved document.
    Approved(Box<Offered>),
    /// That its answer is stored.
    Confirmed(Confirmed),
}

impl Lifecycle {
    /// The document that a robot should hold, with the word, in answer to its question, that it should
    /// hold it now. One that nobody has seen yet counts as offered before it is given out.
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

    /// Signs that a document is wanted. The end is counted from now with each answer, so a robot that
    /// was away for weeks finds one that holds.
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
        Offered { envelope, offer }
    }

    fn signed<T: Statement>(&self, statement: &T) -> Option<Envelope> {
        let signed = sign(statement, &self.inner.key);
        signed
            .inspect_err(|error| tracing::error!(%error, schema = T::SCHEMA, "not signed"))
            .ok()
    }

    /// The same for somebody else, to whom nothing is offered by looking.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn desired(&self, robot: &RobotId) -> Result<Option<Envelope>, StoreError> {
        let ledger = self.ledger(robot);
        let Some(desired) = &ledger.shadow.desired else {
            return Ok(None);
        };
        self.inner.store.envelope(robot, desired.generation).await
    }

    /// What a robot that asks is told of its latest stored answer.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn latest_confirmed(&self, robot: &RobotId) -> Result<Option<Confirmed>, StoreError> {
        self.latest_ledger(robot).await?;
        Ok(self.confirmed(robot))
    }

    /// The same by what this process knows.
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

    /// Returns when something is to be sent.
    pub async fn post_comes(&self) {
        self.inner.outbox.notified().await;
    }

    /// What waits to be sent; what the deployment freeze holds stays where it is.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn outbox(&self) -> Result<Vec<(RobotId, OutboxEntry)>, StoreError> {
        self.inner.store.outbox().await
    }

    /// Makes a entry ready. `None` when it is held, or when something newer has taken its place.
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

    /// Notes that a entry was put on the wire.
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

    /// Counts a document as offered; says whether the robot may see it. The deployment freeze is read
    /// again in the transaction, since it may have come after the look that led here.
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

    /// The generation that a robot gets to see.
    fn shown(&self, ledger: &RobotLedger) -> Option<Generation> {
        let desired = if self.is_held(ledger) {
            let live = ledger.live.as_ref();
            live.and_then(|live| live.desired_before.as_ref())
        } else {
            ledger.shadow.desired.as_ref()
        };
        desired.map(|desired| desired.generation)
    }

    /// Whether the deployment freeze keeps a robot's deployment back. The way back is never kept.
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
