//! What waits for the next transaction.

use std::collections::HashMap;

use fleetcal_domain::limits;
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::EstimateDocument;

use super::accounts::{CredentialUse, TokenRecord, UserRecord, Written};
use super::alerts::AlertChange;
use super::approvals::{Decided, SiteHold};
use super::backend::Batch;
use super::command::{Command, Reply, answer};
use super::error::StoreError;
use super::policy::StoredPolicy;
use super::record::{EventRecord, HistoryRow};
use super::webhooks::WebhookWritten;

/// What waits for the next transaction, and who waits for its end.
#[derive(Debug, Default)]
pub(super) struct Pending {
    pub(super) batch: Batch,
    pub(super) current: HashMap<RobotId, (EstimateDocument, i64)>,
    pub(super) events: Vec<Option<Reply<EventRecord>>>,
    pub(super) robots: Vec<Reply<u64>>,
    pub(super) users: Vec<Reply<Written<UserRecord>>>,
    pub(super) tokens: Vec<Reply<Written<TokenRecord>>>,
    pub(super) decisions: Vec<Reply<Decided>>,
    pub(super) holds: Vec<Reply<SiteHold>>,
    pub(super) policies: Vec<Reply<StoredPolicy>>,
    pub(super) alerts: Vec<Reply<Vec<AlertChange>>>,
    pub(super) webhooks: Vec<Reply<WebhookWritten>>,
    pub(super) waiting: Vec<Reply<()>>,
    pub(super) closers: Vec<Reply<()>>,
    pub(super) everything: bool,
}

/// Rows that were lost.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Lost {
    pub(super) rows: u64,
    /// Seconds of history among them.
    pub(super) history: u64,
}

impl Pending {
    /// Takes a second of history, which is the robot's latest estimate too.
    fn take_second(&mut self, estimate: EstimateDocument, received_ns: i64) {
        let robot = estimate.robot.clone();
        let row = HistoryRow::of(&robot, &estimate, received_ns);
        self.batch.history.push(row);
        self.current.insert(robot, (estimate, received_ns));
    }

    pub(super) fn take(&mut self, command: Command) {
        match command {
            Command::History(estimate, received_ns) => self.take_second(*estimate, received_ns),
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
            Command::Use(used) => {
                let earlier = |earlier: &CredentialUse| earlier.credential == used.credential;
                self.batch.uses.retain(|known| !earlier(known));
                self.batch.uses.push(used);
            }
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
                self.closers.push(reply);
            }
        }
    }

    /// Whether somebody waits, or more has come than one transaction should hold.
    pub(super) fn is_urgent(&self) -> bool {
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
    /// too much. Gives the rows that were lost.
    pub(super) fn refuse(&mut self, error: &StoreError) -> Lost {
        let mut kept = Vec::new();
        for (write, reply) in self.batch.events.drain(..).zip(self.events.drain(..)) {
            match reply {
                Some(reply) => answer(reply, Err(error.clone())),
                None => kept.push(write),
            }
        }
        let lost_events = shed_oldest(&mut kept);
        let lost_uses = shed_oldest(&mut self.batch.uses);
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
        let history = shed_oldest(&mut self.batch.history);
        let rows = history + lost_events + lost_uses;
        Lost { rows, history }
    }

    /// Writes that wait.
    pub(super) fn rows(&self) -> u64 {
        let batch = &self.batch;
        let kept = [
            batch.history.len(),
            batch.current.len(),
            self.current.len(),
            batch.checkpoints.len(),
            batch.cross_tracks.len(),
            batch.events.len(),
            batch.uses.len(),
        ];
        let asked = [
            batch.robots.len(),
            batch.users.len(),
            batch.tokens.len(),
            batch.decisions.len(),
            batch.holds.len(),
            batch.policies.len(),
            batch.alerts.len(),
            batch.webhooks.len(),
        ];
        kept.iter().chain(&asked).sum::<usize>() as u64
    }

    /// What is lost when nothing more is written.
    pub(super) fn left(&self) -> Lost {
        Lost {
            rows: self.rows(),
            history: self.batch.history.len() as u64,
        }
    }
}

/// Drops the oldest entries of a list that has outgrown its limit; gives their number.
fn shed_oldest<T>(list: &mut Vec<T>) -> u64 {
    let lost = list.len().saturating_sub(limits::STORE_QUEUE_MAX);
    list.drain(..lost);
    lost as u64
}
