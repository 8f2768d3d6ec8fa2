//! The one task that writes. It gathers what comes within a second into one transaction; whoever
//! waits for an answer is not kept waiting for the second.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::EstimateDocument;
use tokio::sync::{mpsc, oneshot};
use tokio::time::MissedTickBehavior;

use super::accounts::{CredentialUse, TokenRecord, TokenWrite, UserRecord, UserWrite, Written};
use super::alerts::{AlertChange, AlertWrite};
use super::approvals::{Decided, Decision, HoldWrite, SiteHold};
use super::backend::{Batch, EventWrite, Outcomes, Retention, RobotWrite, Writer};
use super::error::StoreError;
use super::policy::{PolicyWrite, StoredPolicy};
use super::record::{CheckpointRecord, CrossTrackRecord, EventRecord, HistoryRow};
use super::webhooks::{WebhookWrite, WebhookWritten};
use crate::clock::SharedClock;
use crate::limits;

/// Nanoseconds in a second.
const NS_PER_S: i64 = 1_000_000_000;

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

/// What the writer has done since it was started.
#[derive(Debug, Default)]
pub(super) struct WriterCounters {
    pub(super) commits: AtomicU64,
    pub(super) failed_commits: AtomicU64,
    pub(super) history_rows: AtomicU64,
    pub(super) lost: AtomicU64,
    pub(super) pruned_rows: AtomicU64,
}

/// What waits for the next transaction, and who waits for its end.
#[derive(Debug, Default)]
struct Pending {
    batch: Batch,
    current: HashMap<RobotId, (EstimateDocument, i64)>,
    events: Vec<Option<Reply<EventRecord>>>,
    robots: Vec<Reply<u64>>,
    users: Vec<Reply<Written<UserRecord>>>,
    tokens: Vec<Reply<Written<TokenRecord>>>,
    decisions: Vec<Reply<Decided>>,
    holds: Vec<Reply<SiteHold>>,
    policies: Vec<Reply<StoredPolicy>>,
    alerts: Vec<Reply<Vec<AlertChange>>>,
    webhooks: Vec<Reply<WebhookWritten>>,
    waiting: Vec<Reply<()>>,
    everything: bool,
    close: bool,
}

/// The task's state.
#[derive(Debug)]
pub(super) struct WriterTask<W> {
    database: Box<W>,
    clock: SharedClock,
    counters: Arc<WriterCounters>,
    pending: Pending,
    /// When the stored estimate of each robot was last written, receipt time.
    current_written_ns: HashMap<RobotId, i64>,
}

impl<W: Writer> WriterTask<W> {
    pub(super) fn new(database: W, clock: SharedClock, counters: Arc<WriterCounters>) -> Self {
        Self {
            database: Box::new(database),
            clock,
            counters,
            pending: Pending::default(),
            current_written_ns: HashMap::new(),
        }
    }

    /// Writes until the store is closed or nobody holds it any more.
    pub(super) async fn run(mut self, mut commands: mpsc::Receiver<Command>) {
        let mut tick = tokio::time::interval(limits::STORE_FLUSH_EVERY);
        tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut inbox = Vec::with_capacity(limits::STORE_BATCH_MAX);
        let mut held = true;
        while held && !self.pending.close {
            tokio::select! {
                received = commands.recv_many(&mut inbox, limits::STORE_BATCH_MAX) => {
                    held = received > 0;
                    for command in inbox.drain(..) {
                        self.pending.take(command);
                    }
                    if self.pending.is_urgent() || !held {
                        self.commit(None).await;
                    }
                }
                _ = tick.tick() => {
                    let retention = retention(self.clock.now_ns());
                    self.commit(Some(retention)).await;
                }
            }
        }
        let closers = std::mem::take(&mut self.pending.waiting);
        let closed = self.database.close().await;
        if let Err(error) = &closed {
            tracing::error!(%error, "the database could not be closed");
        }
        for closer in closers {
            answer(closer, closed.clone());
        }
    }

    async fn commit(&mut self, retention: Option<Retention>) {
        self.pending.batch.retention = retention;
        self.choose_current();
        let now_ns = self.clock.now_ns();
        if !self.pending.waiting.is_empty() {
            self.pending.batch.probe_ns = Some(now_ns);
        }
        let result = self.database.commit(&self.pending.batch).await;
        match result {
            Ok(outcomes) => self.committed(outcomes),
            Err(error) => self.failed(&error),
        }
    }

    /// Takes the latest estimates whose turn has come into the batch: a robot's estimate is
    /// replaced every few seconds, not every second.
    fn choose_current(&mut self) {
        let everything = self.pending.everything;
        let every_ns = i64::try_from(limits::STORE_CURRENT_EVERY.as_nanos()).unwrap_or(i64::MAX);
        let written = &mut self.current_written_ns;
        let due = |robot: &RobotId, received_ns: i64| match written.get(robot) {
            Some(last_ns) => everything || received_ns.saturating_sub(*last_ns) >= every_ns,
            None => true,
        };
        let chosen: Vec<_> = self
            .pending
            .current
            .extract_if(|robot, (_, received_ns)| due(robot, *received_ns))
            .collect();
        for (robot, (estimate, received_ns)) in chosen {
            written.insert(robot, received_ns);
            self.pending.batch.current.push((estimate, received_ns));
        }
    }

    fn committed(&mut self, outcomes: Outcomes) {
        let batch = std::mem::take(&mut self.pending.batch);
        let counters = &self.counters;
        counters.commits.fetch_add(1, Ordering::Relaxed);
        counters
            .history_rows
            .fetch_add(batch.history.len() as u64, Ordering::Relaxed);
        counters
            .pruned_rows
            .fetch_add(outcomes.pruned, Ordering::Relaxed);
        for (reply, outcome) in self.pending.events.drain(..).zip(outcomes.events) {
            if let Some(reply) = reply {
                answer(reply, outcome);
            }
        }
        for (reply, outcome) in self.pending.robots.drain(..).zip(outcomes.robots) {
            answer(reply, outcome);
        }
        for (reply, outcome) in self.pending.users.drain(..).zip(outcomes.users) {
            answer(reply, outcome);
        }
        for (reply, outcome) in self.pending.tokens.drain(..).zip(outcomes.tokens) {
            answer(reply, outcome);
        }
        for (reply, outcome) in self.pending.decisions.drain(..).zip(outcomes.decisions) {
            answer(reply, outcome);
        }
        for (reply, outcome) in self.pending.holds.drain(..).zip(outcomes.holds) {
            answer(reply, outcome);
        }
        for (reply, outcome) in self.pending.policies.drain(..).zip(outcomes.policies) {
            answer(reply, outcome);
        }
        for (reply, outcome) in self.pending.alerts.drain(..).zip(outcomes.alerts) {
            answer(reply, outcome);
        }
        for (reply, outcome) in self.pending.webhooks.drain(..).zip(outcomes.webhooks) {
            answer(reply, outcome);
        }
        self.pending.everything = false;
        if !self.pending.close {
            for reply in self.pending.waiting.drain(..) {
                answer(reply, Ok(()));
            }
        }
    }

    /// Tells those who wait, and keeps the rest for the next transaction as far as it may grow.
    fn failed(&mut self, error: &StoreError) {
        self.counters.failed_commits.fetch_add(1, Ordering::Relaxed);
        tracing::error!(%error, source = ?std::error::Error::source(error), "a commit failed");
        let lost = self.pending.refuse(error);
        if lost > 0 {
            self.counters.lost.fetch_add(lost, Ordering::Relaxed);
            tracing::error!(rows = lost, "history was lost because the database fails");
        }
    }
}

impl Pending {
    fn take(&mut self, command: Command) {
        match command {
            Command::History(estimate, received_ns) => {
                let robot = estimate.robot.clone();
                self.batch
                    .history
                    .push(HistoryRow::of(&robot, &estimate, received_ns));
                self.current.insert(robot, (*estimate, received_ns));
            }
            Command::Checkpoint(record) => {
                self.batch
                    .checkpoints
                    .retain(|earlier| earlier.robot != record.robot);
                self.batch.checkpoints.push(record);
            }
            Command::CrossTrack(record) => {
                self.batch.cross_tracks.retain(|earlier| {
                    earlier.robot != record.robot || earlier.generation != record.generation
                });
                self.batch.cross_tracks.push(*record);
            }
            Command::Event(write, reply) => {
                self.batch.events.push(write);
                self.events.push(reply);
            }
            Command::Robot(write, reply) => {
                self.batch.robots.push(*write);
                self.robots.push(reply);
            }
            Command::User(write, reply) => {
                self.batch.users.push(*write);
                self.users.push(reply);
            }
            Command::Token(write, reply) => {
                self.batch.tokens.push(*write);
                self.tokens.push(reply);
            }
            Command::Use(used) => self.batch.uses.push(used),
            Command::Decide(decision, reply) => {
                self.batch.decisions.push(*decision);
                self.decisions.push(reply);
            }
            Command::Hold(write, reply) => {
                self.batch.holds.push(*write);
                self.holds.push(reply);
            }
            Command::Policy(write, reply) => {
                self.batch.policies.push(*write);
                self.policies.push(reply);
            }
            Command::Alerts(write, reply) => {
                self.batch.alerts.push(*write);
                self.alerts.push(reply);
            }
            Command::Webhook(write, reply) => {
                self.batch.webhooks.push(*write);
                self.webhooks.push(reply);
            }
            Command::Probe(reply) => self.waiting.push(reply),
            Command::Flush(reply) => {
                self.everything = true;
                self.waiting.push(reply);
            }
            Command::Close(reply) => {
                self.everything = true;
                self.close = true;
                self.waiting.push(reply);
            }
        }
    }

    /// Whether somebody waits, or more has come than one transaction should hold.
    fn is_urgent(&self) -> bool {
        !self.waiting.is_empty()
            || !self.robots.is_empty()
            || !self.users.is_empty()
            || !self.tokens.is_empty()
            || !self.decisions.is_empty()
            || !self.holds.is_empty()
            || !self.policies.is_empty()
            || !self.alerts.is_empty()
            || !self.webhooks.is_empty()
            || self.events.iter().any(Option::is_some)
            || self.batch.history.len() >= limits::STORE_BATCH_MAX
    }

    /// Answers everybody with `error`; keeps what nobody waits for, the newest of it when there is
    /// too much. Gives the number of rows that were lost.
    fn refuse(&mut self, error: &StoreError) -> u64 {
        let mut kept = Vec::new();
        for (write, reply) in self.batch.events.drain(..).zip(self.events.drain(..)) {
            match reply {
                Some(reply) => answer(reply, Err(error.clone())),
                None => kept.push(write),
            }
        }
        let lost_events = shed_oldest(&mut kept);
        self.events = kept.iter().map(|_| None).collect();
        self.batch.events = kept;
        self.batch.robots.clear();
        for reply in self.robots.drain(..) {
            answer(reply, Err(error.clone()));
        }
        self.batch.users.clear();
        for reply in self.users.drain(..) {
            answer(reply, Err(error.clone()));
        }
        self.batch.tokens.clear();
        for reply in self.tokens.drain(..) {
            answer(reply, Err(error.clone()));
        }
        self.batch.uses.clear();
        self.batch.decisions.clear();
        for reply in self.decisions.drain(..) {
            answer(reply, Err(error.clone()));
        }
        self.batch.holds.clear();
        for reply in self.holds.drain(..) {
            answer(reply, Err(error.clone()));
        }
        self.batch.policies.clear();
        for reply in self.policies.drain(..) {
            answer(reply, Err(error.clone()));
        }
        self.batch.alerts.clear();
        for reply in self.alerts.drain(..) {
            answer(reply, Err(error.clone()));
        }
        self.batch.webhooks.clear();
        for reply in self.webhooks.drain(..) {
            answer(reply, Err(error.clone()));
        }
        for reply in self.waiting.drain(..) {
            answer(reply, Err(error.clone()));
        }
        self.batch.probe_ns = None;
        self.batch.retention = None;
        self.everything = false;
        for (estimate, received_ns) in self.batch.current.drain(..) {
            self.current
                .entry(estimate.robot.clone())
                .or_insert((estimate, received_ns));
        }
        lost_events + shed_oldest(&mut self.batch.history)
    }
}

/// Drops the oldest entries of a list that has outgrown its limit; gives their number.
fn shed_oldest<T>(list: &mut Vec<T>) -> u64 {
    let lost = list.len().saturating_sub(limits::STORE_QUEUE_MAX);
    list.drain(..lost);
    lost as u64
}

/// Answers somebody who may have gone.
fn answer<T>(reply: Reply<T>, result: Result<T, StoreError>) {
    if reply.send(result).is_err() {
        tracing::debug!("nobody waited for the end of a write any more");
    }
}

/// What is too old at `now_ns`.
fn retention(now_ns: i64) -> Retention {
    let now_s = now_ns.div_euclid(NS_PER_S);
    let before = |kept: std::time::Duration| {
        now_s.saturating_sub(i64::try_from(kept.as_secs()).unwrap_or(i64::MAX))
    };
    Retention {
        seconds_before: before(limits::HISTORY_SECONDS_KEPT),
        minutes_before: before(limits::HISTORY_MINUTES_KEPT),
        hours_before: before(limits::HISTORY_HOURS_KEPT),
        idempotency_before: before(limits::IDEMPOTENCY_KEPT),
        alerts_before: before(limits::ALERTS_KEPT),
        rows_max: limits::RETENTION_ROWS_MAX,
    }
}
