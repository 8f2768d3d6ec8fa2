//! Somebody who has heard every acknowledged decision, and compares a database with it.

use std::collections::BTreeMap;
use std::sync::Arc;

use fleetcal_clock::SystemClock;
use fleetcal_proto::signing::{SigningKey, TrustedKeys};
use fleetcal_sqlite::Outlives;
use serde_json::Value;

use crate::durability::place::Place;
use crate::durability::records::{self, Audited, Records};
use crate::durability::said::{Effect, Row, Said};

/// Fault of a database.
#[derive(Debug, Clone, PartialEq)]
pub enum Fault {
    /// An acknowledged decision is missing.
    Lost(String),
    /// A decision is stored in part.
    Half(String),
    /// The database cannot be opened, or is not sound.
    Damaged(String),
    /// Records contradict each other.
    Disagrees(String),
}

/// Witness of all acknowledged decisions.
#[derive(Debug, Clone, Default)]
pub struct Witness {
    done: BTreeMap<String, Vec<Row>>,
    outbox: BTreeMap<(String, String), u64>,
    in_flight: BTreeMap<String, Effect>,
    /// Decisions that were acknowledged.
    pub acknowledged: usize,
    /// Stored decisions without an acknowledgement.
    pub unheard: usize,
}

impl Witness {
    /// Records a line.
    pub fn hear(&mut self, said: Said) {
        match said {
            Said::Tries(effect) => {
                self.in_flight.insert(effect.robot.clone(), effect);
            }
            Said::Done(effect) => {
                self.in_flight.remove(&effect.robot);
                self.acknowledged += 1;
                send(&mut self.outbox, &effect);
                self.done
                    .entry(effect.robot)
                    .or_default()
                    .extend(effect.rows);
            }
            Said::Refused { robot } => {
                self.in_flight.remove(&robot);
            }
            Said::Opened | Said::Closed => {}
        }
    }

    /// Opens a database as the service does, and compares all of it.
    ///
    /// # Errors
    /// The fault.
    pub async fn check(&self, place: &Place) -> Result<Records, Fault> {
        let damaged = |error: &dyn std::error::Error| {
            Fault::Damaged(format!(
                "{error}: {:?}",
                error.source().map(ToString::to_string)
            ))
        };
        let clock = Arc::new(SystemClock::start());
        let store = place
            .open(clock, Outlives::Power)
            .await
            .map_err(|error| damaged(&error))?;
        store
            .load_ledgers()
            .await
            .map_err(|error| damaged(&error))?;
        let records = records::read(place).await.map_err(|error| damaged(&error));
        store.close().await.map_err(|error| damaged(&error))?;
        let records = records?;
        if !records.complaints.is_empty() {
            return Err(Fault::Damaged(records.complaints.join("; ")));
        }
        self.nothing_is_lost(&records)?;
        self.outbox_is_right(&records)?;
        audit_agrees(&records)?;
        deployments_agree(&records)?;
        Ok(records)
    }

    /// Continues from the content of a database: decisions in progress are settled now.
    pub fn settle(&mut self, records: &Records) {
        self.unheard += self
            .in_flight
            .values()
            .filter(|effect| self.is_there(effect, records))
            .count();
        self.in_flight.clear();
        let rows = |audit: &Vec<Audited>| audit.iter().map(|one| one.row.clone()).collect();
        let audit = records.audit.iter();
        self.done = audit
            .map(|(robot, audit)| (robot.clone(), rows(audit)))
            .collect();
        self.outbox.clone_from(&records.outbox);
    }

    fn is_there(&self, effect: &Effect, records: &Records) -> bool {
        let found = records.audit.get(&effect.robot).map_or(0, Vec::len);
        let heard = self.done.get(&effect.robot).map_or(0, Vec::len);
        found > heard
    }

    /// Checks that every acknowledged row is stored, followed by all rows of the decision in
    /// progress or none.
    fn nothing_is_lost(&self, records: &Records) -> Result<(), Fault> {
        for (robot, heard) in &self.done {
            let found = records.audit.get(robot).map_or(&[][..], Vec::as_slice);
            let pairs = heard.iter().zip(found);
            let same = pairs
                .take_while(|(heard, found)| **heard == found.row)
                .count();
            if same < heard.len() {
                let first = heard.get(same).map(|row| row.action.clone());
                return Err(Fault::Lost(format!(
                    "{robot}: {same} of {} rows, then {first:?}",
                    heard.len()
                )));
            }
        }
        for (robot, found) in &records.audit {
            let heard = self.done.get(robot).map_or(0, Vec::len);
            let more: Vec<_> = found
                .iter()
                .skip(heard)
                .map(|one| &one.row.action)
                .collect();
            let tried = self.in_flight.get(robot);
            let tried: Vec<_> = tried
                .iter()
                .flat_map(|one| &one.rows)
                .map(|row| &row.action)
                .collect();
            if !more.is_empty() && more != tried {
                return Err(Fault::Half(format!("{robot}: {more:?} of {tried:?}")));
            }
        }
        Ok(())
    }

    /// Checks that exactly the messages to be sent are in the outbox.
    fn outbox_is_right(&self, records: &Records) -> Result<(), Fault> {
        let mut sure = self.outbox.clone();
        let mut unsure = Vec::new();
        for effect in self.in_flight.values() {
            if self.is_there(effect, records) {
                send(&mut sure, effect);
            } else if effect.rows.is_empty() {
                unsure.push(effect);
            }
        }
        // A decision without a row of its own is there or not, and nobody can tell.
        for effect in unsure {
            let mut then = sure.clone();
            send(&mut then, effect);
            let of = |outbox: &BTreeMap<(String, String), u64>| -> Vec<(String, u64)> {
                let own = outbox
                    .iter()
                    .filter(|((robot, _), _)| *robot == effect.robot);
                own.map(|((_, kind), generation)| (kind.clone(), *generation))
                    .collect()
            };
            if of(&then) == of(&records.outbox) {
                sure = then;
            }
        }
        if sure != records.outbox {
            let found = &records.outbox;
            return Err(Fault::Lost(format!(
                "the outbox is {found:?} instead of {sure:?}"
            )));
        }
        Ok(())
    }
}

/// Applies a decision to the outbox.
fn send(outbox: &mut BTreeMap<(String, String), u64>, effect: &Effect) {
    let of = |kind: &str| (effect.robot.clone(), kind.to_owned());
    if let Some((kind, generation)) = &effect.sent
        && outbox.get(&of(kind)) == Some(generation)
    {
        outbox.remove(&of(kind));
    }
    for (kind, generation) in &effect.outbox {
        outbox.insert(of(kind), *generation);
    }
}

/// Checks that replaying the audit yields the records, and that the robots' histories agree.
fn audit_agrees(records: &Records) -> Result<(), Fault> {
    let mut replayed: BTreeMap<(String, String), Value> = BTreeMap::new();
    let mut events: BTreeMap<(String, String), usize> = BTreeMap::new();
    for (robot, audit) in &records.audit {
        for one in audit {
            let row = &one.row;
            let name = (row.subject.clone(), row.subject_id.clone());
            let last = replayed.insert(name, row.after.clone());
            // A robot of which nothing is known has a shadow before its first row.
            let is_first_shadow = row.subject == "shadow" && last.is_none();
            if last != one.before && !is_first_shadow {
                return Err(Fault::Disagrees(format!("before of {row:?} is {last:?}")));
            }
            let kind = match row.action.as_str() {
                "proposal.create" => "proposed",
                "proposal.approve" => "approved",
                "deployment.offer" => "offered",
                "deployment.verify" => "verified",
                _ => continue,
            };
            *events.entry((robot.clone(), kind.to_owned())).or_default() += 1;
        }
    }
    if replayed != records.by_subject {
        let differ = records
            .by_subject
            .iter()
            .find(|(name, record)| replayed.get(*name) != Some(*record));
        return Err(Fault::Disagrees(format!(
            "the audit does not give {differ:?}"
        )));
    }
    for (name, count) in events {
        let found = records.events.get(&name).copied().unwrap_or(0);
        if found != count {
            return Err(Fault::Disagrees(format!(
                "{found} instead of {count} {name:?}"
            )));
        }
    }
    Ok(())
}

/// Checks for one live deployment a robot, one for each approved proposal, each with its signed
/// document.
fn deployments_agree(records: &Records) -> Result<(), Fault> {
    let key = SigningKey::from_bytes(&[7; 32]).public_key();
    let trusted = TrustedKeys::new(vec![key]).map_err(|error| Fault::Damaged(error.to_string()))?;
    let of = |subject: &'static str| {
        let all = records.by_subject.iter();
        all.filter(move |((found, _), _)| found == subject)
            .map(|(_, record)| record)
    };
    let mut live: BTreeMap<&str, usize> = BTreeMap::new();
    let mut brought: BTreeMap<u64, usize> = BTreeMap::new();
    for deployment in of("deployment") {
        let robot = deployment["robot"].as_str().unwrap_or_default();
        let state = deployment["state"].as_str().unwrap_or_default();
        if ["queued", "offered", "applied", "verifying", "rolling_back"].contains(&state) {
            *live.entry(robot).or_default() += 1;
        }
        if let Some(proposal) = deployment["proposal"].as_u64() {
            *brought.entry(proposal).or_default() += 1;
        }
        let earlier = deployment["earlier"].as_array().into_iter().flatten();
        for offer in earlier.chain([&deployment["offer"]]) {
            let generation = offer["generation"].as_u64().unwrap_or_default();
            let envelope = records.envelopes.get(&(robot.to_owned(), generation));
            let document = envelope.map(|envelope| envelope.open(&trusted));
            let Some(Ok(document)) = document else {
                return Err(Fault::Half(format!(
                    "no document for {offer}: {document:?}"
                )));
            };
            let same = envelope.is_some_and(|one| offer["sha256"] == one.sha256);
            if !same || offer["revision"] != document.revision.0 {
                return Err(Fault::Disagrees(format!("{offer} is another document")));
            }
        }
    }
    if let Some(two) = live.iter().find(|(_, count)| **count > 1) {
        return Err(Fault::Disagrees(format!(
            "{two:?} deployments are under way"
        )));
    }
    for proposal in of("proposal") {
        let id = proposal["id"].as_u64().unwrap_or_default();
        let deployments = brought.get(&id).copied().unwrap_or(0);
        if deployments != usize::from(proposal["state"] == "approved") {
            return Err(Fault::Half(format!(
                "{deployments} deployments of {proposal}"
            )));
        }
        let revision = proposal["revision"].as_u64().unwrap_or_default();
        let sha256 = records.revisions.get(&revision);
        if sha256.is_none_or(|sha256| proposal["revision_sha256"] != **sha256) {
            return Err(Fault::Half(format!("no revision for {proposal}")));
        }
    }
    Ok(())
}
