//! Reads what deciders, the database and a listener on Zenoh have seen, and says what several
//! instances must not have done. Pure.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

/// Outcome of a decision for its caller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// An instance acknowledged it.
    Acknowledged,
    /// An instance refused it.
    Refused,
    /// The caller got no answer: it may have been taken.
    Unknown,
}

/// A decision, as its caller knows it.
#[derive(Debug, Clone)]
pub struct Decision {
    /// Its reason, which is unique.
    pub reason: String,
    /// Its outcome.
    pub outcome: Outcome,
}

/// A row of the audit.
#[derive(Debug, Clone)]
pub struct Audited {
    /// Its number; the numbers have no gaps.
    pub id: i64,
    /// The action.
    pub action: String,
    /// The subject, by kind and number.
    pub subject: String,
    /// The reason.
    pub reason: String,
}

/// A change of a robot's owner, in the order of the database's commits.
#[derive(Debug, Clone)]
pub struct Owned {
    /// The robot.
    pub robot: String,
    /// Owner from then on; `None` without any.
    pub owner: Option<String>,
    /// Epoch of the latest tenure.
    pub epoch: i64,
    /// Time of its commit, µs.
    pub committed_us: i64,
}

/// A row of telemetry that an instance has written.
#[derive(Debug, Clone)]
pub struct Written {
    /// The robot.
    pub robot: String,
    /// The table.
    pub table: String,
    /// The instance.
    pub by: String,
    /// Time of its commit, µs.
    pub committed_us: i64,
}

/// An estimate received on Zenoh.
#[derive(Debug, Clone)]
pub struct Estimated {
    /// The robot.
    pub robot: String,
    /// The instance.
    pub by: String,
    /// The epoch.
    pub epoch: i64,
}

/// A document of an approved calibration received on Zenoh.
#[derive(Debug, Clone)]
pub struct Offered {
    /// The robot.
    pub robot: String,
    /// Its generation.
    pub generation: u64,
    /// Hash of the sent document.
    pub sha256: String,
}

/// All evidence, each kind in its order.
#[derive(Debug, Clone, Default)]
pub struct Evidence {
    /// Decisions.
    pub decisions: Vec<Decision>,
    /// The audit, by number.
    pub audit: Vec<Audited>,
    /// Owners of the robots, as committed.
    pub owners: Vec<Owned>,
    /// Written rows.
    pub written: Vec<Written>,
    /// Estimates in the order of their arrival.
    pub estimates: Vec<Estimated>,
    /// Documents in the order of their arrival.
    pub documents: Vec<Offered>,
}

/// Violation of an invariant.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum Violation {
    /// An acknowledged decision is not in the audit.
    Lost { reason: String },
    /// A decision is in the audit more than once.
    Repeated { reason: String, times: usize },
    /// A refused decision is in the audit.
    TakenThoughRefused { reason: String },
    /// Two decisions were made on the same subject.
    DecidedTwice { subject: String },
    /// A number of the audit is missing.
    AuditGap { before: i64 },
    /// The epoch of a robot did not grow with its owner.
    EpochNotRaised { robot: String, epoch: i64 },
    /// A row came from an instance that did not have the robot when it was committed.
    StaleRow {
        robot: String,
        table: String,
        by: String,
        owner: Option<String>,
    },
    /// More than one estimate came after one of a later tenure.
    StaleEstimates {
        robot: String,
        by: String,
        epoch: i64,
        count: usize,
    },
    /// Two instances published estimates in one epoch.
    EpochShared { robot: String, epoch: i64 },
    /// A document came after a later one.
    StaleDocument { robot: String, generation: u64 },
    /// Two documents have one generation.
    GenerationShared { robot: String, generation: u64 },
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self:?}")
    }
}

/// Most estimates of an ended tenure that may come after one of the next: one that was in flight.
const LATE_ESTIMATES_MAX: usize = 1;

impl Evidence {
    /// Returns its violations.
    pub fn violations(&self) -> Vec<Violation> {
        let mut found = self.of_decisions();
        found.extend(self.of_owners());
        found.extend(self.of_rows());
        found.extend(self.of_estimates());
        found.extend(self.of_documents());
        found
    }

    /// Counts the estimates that came after one of a later tenure of the same robot, by robot and
    /// epoch.
    pub fn stale_estimates(&self) -> BTreeMap<(String, i64, String), usize> {
        let mut highest: BTreeMap<&str, i64> = BTreeMap::new();
        let mut stale = BTreeMap::new();
        for one in &self.estimates {
            let known = highest.entry(&one.robot).or_insert(one.epoch);
            if one.epoch < *known {
                let of = (one.robot.clone(), one.epoch, one.by.clone());
                *stale.entry(of).or_insert(0) += 1;
            }
            *known = (*known).max(one.epoch);
        }
        stale
    }

    fn of_decisions(&self) -> Vec<Violation> {
        let mut times: BTreeMap<&str, usize> = BTreeMap::new();
        for row in &self.audit {
            *times.entry(&row.reason).or_default() += 1;
        }
        let mut found = Vec::new();
        for Decision { reason, outcome } in &self.decisions {
            let reason = reason.clone();
            match (outcome, times.get(reason.as_str()).copied().unwrap_or(0)) {
                (Outcome::Acknowledged, 0) => found.push(Violation::Lost { reason }),
                (Outcome::Refused, 1..) => found.push(Violation::TakenThoughRefused { reason }),
                (_, times @ 2..) => found.push(Violation::Repeated { reason, times }),
                _ => {}
            }
        }
        let mut approved = BTreeSet::new();
        for row in self
            .audit
            .iter()
            .filter(|row| row.action == "proposal.approve")
        {
            if !approved.insert(&row.subject) {
                let subject = row.subject.clone();
                found.push(Violation::DecidedTwice { subject });
            }
        }
        for (one, next) in self.audit.iter().zip(self.audit.iter().skip(1)) {
            if next.id != one.id + 1 {
                found.push(Violation::AuditGap { before: next.id });
            }
        }
        found
    }

    fn of_owners(&self) -> Vec<Violation> {
        let mut last: BTreeMap<&str, i64> = BTreeMap::new();
        let mut found = Vec::new();
        for row in self.owners.iter().filter(|row| row.owner.is_some()) {
            let before = last.insert(&row.robot, row.epoch);
            if before.is_some_and(|before| row.epoch <= before) {
                let (robot, epoch) = (row.robot.clone(), row.epoch);
                found.push(Violation::EpochNotRaised { robot, epoch });
            }
        }
        found
    }

    /// Compares each row with the robot's owner at the moment of its commit.
    fn of_rows(&self) -> Vec<Violation> {
        let mut of: BTreeMap<&str, Vec<&Owned>> = BTreeMap::new();
        for change in &self.owners {
            of.entry(&change.robot).or_default().push(change);
        }
        let stale = |row: &&Written| {
            let changes = of.get(row.robot.as_str()).map_or(&[][..], Vec::as_slice);
            let before = changes.partition_point(|one| one.committed_us < row.committed_us);
            let owner = before
                .checked_sub(1)
                .and_then(|last| changes[last].owner.clone());
            (owner.as_ref() != Some(&row.by)).then(|| Violation::StaleRow {
                robot: row.robot.clone(),
                table: row.table.clone(),
                by: row.by.clone(),
                owner,
            })
        };
        self.written.iter().filter_map(|row| stale(&row)).collect()
    }

    fn of_estimates(&self) -> Vec<Violation> {
        let late = self.stale_estimates().into_iter();
        let late = late.filter(|(_, count)| *count > LATE_ESTIMATES_MAX);
        let mut found: Vec<_> = late
            .map(|((robot, epoch, by), count)| Violation::StaleEstimates {
                robot,
                by,
                epoch,
                count,
            })
            .collect();
        let mut by: BTreeMap<(&str, i64), &str> = BTreeMap::new();
        let mut shared = BTreeSet::new();
        for one in &self.estimates {
            let first = by.entry((&one.robot, one.epoch)).or_insert(&one.by);
            if *first != one.by {
                shared.insert((one.robot.clone(), one.epoch));
            }
        }
        let shared = shared.into_iter();
        found.extend(shared.map(|(robot, epoch)| Violation::EpochShared { robot, epoch }));
        found
    }

    fn of_documents(&self) -> Vec<Violation> {
        let mut latest: BTreeMap<&str, u64> = BTreeMap::new();
        let mut hashes: BTreeMap<(&str, u64), &str> = BTreeMap::new();
        let mut found = Vec::new();
        for one in &self.documents {
            let (robot, generation) = (one.robot.clone(), one.generation);
            let known = latest.entry(&one.robot).or_insert(generation);
            if generation < *known {
                let robot = robot.clone();
                found.push(Violation::StaleDocument { robot, generation });
            }
            *known = (*known).max(generation);
            let sent = hashes
                .entry((&one.robot, generation))
                .or_insert(&one.sha256);
            if *sent != one.sha256 {
                found.push(Violation::GenerationShared { robot, generation });
            }
        }
        found
    }
}

#[cfg(test)]
#[path = "checker_tests.rs"]
mod tests;
