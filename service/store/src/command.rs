//! What the writer is asked to do.

use fleetcal_domain::limits;
use fleetcal_proto::estimate::EstimateDocument;
use tokio::sync::oneshot;
use tokio::time::Instant;

use super::accounts::{CredentialUse, TokenRecord, TokenWrite, UserRecord, UserWrite, Written};
use super::alerts::{AlertChange, AlertWrite};
use super::approvals::{Decided, Decision, HoldWrite, SiteHold};
use super::backend::{EventWrite, RobotWrite};
use super::error::StoreError;
use super::policy::{PolicyWrite, StoredPolicy};
use super::record::{CheckpointRecord, CrossTrackRecord, EventRecord};
use super::webhooks::{WebhookWrite, WebhookWritten};

/// Where an answer goes.
pub(super) type Reply<T> = oneshot::Sender<Result<T, StoreError>>;

/// What the writer is asked to do.
#[derive(Debug)]
pub(super) enum Command {
    /// Keep an estimate.
    History(Box<EstimateDocument>, i64),
    /// Keep an estimator's state.
    Checkpoint(CheckpointRecord),
    /// Keep how well a robot follows its path.
    CrossTrack(Box<CrossTrackRecord>),
    /// Keep an event, and say so if somebody waits.
    Event(EventWrite, Option<Reply<EventRecord>>),
    /// Keep a configuration.
    Robot(Box<RobotWrite>, Reply<u64>),
    /// Change a user.
    User(Box<UserWrite>, Reply<Written<UserRecord>>),
    /// Change a token.
    Token(Box<TokenWrite>, Reply<Written<TokenRecord>>),
    /// Note that a session or token was used.
    Use(CredentialUse),
    /// Take a decision on a robot's records.
    Decide(Box<Decision>, Reply<Decided>),
    /// Hold or release the site-wide stop.
    Hold(Box<HoldWrite>, Reply<SiteHold>),
    /// Set the policy.
    Policy(Box<PolicyWrite>, Reply<StoredPolicy>),
    /// Change alerts.
    Alerts(Box<AlertWrite>, Reply<Vec<AlertChange>>),
    /// Change a webhook or a delivery.
    Webhook(Box<WebhookWrite>, Reply<WebhookWritten>),
    /// Prove that the database can be written.
    Probe(Reply<()>),
    /// Write everything that was asked for before.
    Flush(Reply<()>),
    /// The same, then close.
    Close(Reply<()>),
}

/// A command in the writer's queue.
#[derive(Debug)]
pub(super) struct Queued {
    pub(super) command: Command,
    /// When it was asked for, by whoever waits for its end.
    pub(super) asked_at: Option<Instant>,
}

impl Queued {
    /// The command, unless it comes too late for whoever asked: then that is the answer. So
    /// nothing is changed long after its request was answered.
    pub(super) fn in_time(self) -> Option<Command> {
        match self.asked_at {
            Some(asked_at) if asked_at.elapsed() > limits::STORE_ANSWER_WITHIN => {
                self.command.refuse(StoreError::Late)
            }
            _ => Some(self.command),
        }
    }
}

impl Command {
    /// Answers whoever waits with an error; gives back what is done without anybody waiting, and
    /// what writes nothing of its own.
    fn refuse(self, error: StoreError) -> Option<Self> {
        match self {
            Self::Event(_, Some(reply)) => answer(reply, Err(error)),
            Self::Robot(_, reply) => answer(reply, Err(error)),
            Self::User(_, reply) => answer(reply, Err(error)),
            Self::Token(_, reply) => answer(reply, Err(error)),
            Self::Decide(_, reply) => answer(reply, Err(error)),
            Self::Hold(_, reply) => answer(reply, Err(error)),
            Self::Policy(_, reply) => answer(reply, Err(error)),
            Self::Alerts(_, reply) => answer(reply, Err(error)),
            Self::Webhook(_, reply) => answer(reply, Err(error)),
            kept @ (Self::History(..)
            | Self::Checkpoint(_)
            | Self::CrossTrack(_)
            | Self::Event(_, None)
            | Self::Use(_)
            | Self::Probe(_)
            | Self::Flush(_)
            | Self::Close(_)) => return Some(kept),
        }
        None
    }
}

/// Answers somebody who may have gone.
pub(super) fn answer<T>(reply: Reply<T>, result: Result<T, StoreError>) {
    if reply.send(result).is_err() {
        tracing::debug!("nobody waited for the end of a write any more");
    }
}
