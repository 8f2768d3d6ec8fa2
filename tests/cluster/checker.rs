//! Reads what deciders, the database and a listener on Zenoh have seen, and says what several
//! instances must not have done. Pure.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

/// How a decision ended for the one who asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// An instance said that it is taken.
    Acknowledged,
    /// An instance said that it is not.
    Refused,
    /// Nobody said: it may have been taken.
    Unknown,
}

/// A decision, as the one who asked for it knows it.
#[derive(Debug, Clone)]
pub struct Decision {
    /// Its reason, which no other decision has.
    pub reason: String,
    /// How it ended.
    pub outcome: Outcome,
}

/// A row of the audit.
#[derive(Debug, Clone)]
pub struct Audited {
    /// Its number; they have no gaps.
    pub id: i64,
    /// What was done.
    pub action: String,
    /// To what, by kind and number.
    pub subject: String,
    /// Why.
    pub reason: String,
}

/// A change of who has a robot, in the order in which the database committed it.
#[derive(Debug, Clone)]
pub struct Owned {
    /// Which robot.
    pub robot: String,
    /// Which instance has it from then on; `None` when nobody has.
    pub owner: Option<String>,
    /// The epoch of the latest tenure.
    pub epoch: i64,
    /// When it was committed, µs.
    pub committed_us: i64,
}

/// A row of telemetry that an instance has written.
#[derive(Debug, Clone)]
pub struct Written {
    /// Of which robot.
    pub robot: String,
    /// In which table.
    pub table: String,
    /// By which instance.
    pub by: String,
    /// When it was committed, µs.
    pub committed_us: i64,
}

/// An estimate that came on Zenoh.
#[derive(Debug, Clone)]
pub struct Estimated {
    /// Of which robot.
    pub robot: String,
    /// By which instance.
    pub by: String,
    /// In which epoch.
    pub epoch: i64,
}

/// A document of an approved calibration that came on Zenoh.
#[derive(Debug, Clone)]
pub struct Offered {
    /// For which robot.
    pub robot: String,
    /// Which of its generations.
    pub generation: u64,
    /// The hash of what was sent.
    pub sha256: String,
}

/// All that was seen, each in its order.
#[derive(Debug, Clone, Default)]
pub struct Evidence {
    /// What was decided.
    pub decisions: Vec<Decision>,
    /// The audit, by number.
    pub audit: Vec<Audited>,
    /// Who had which robot, as committed.
    pub owners: Vec<Owned>,
    /// What was written.
    pub written: Vec<Written>,
    /// What came, in the order of its arrival.
    pub estimates: Vec<Estimated>,
    /// What came, in the order of its arrival.
    pub documents: Vec<Offered>,
}

/// What must not be.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum Violation {
    /// An acknowledged decision is not in the audit.
    Lost { reason: String },
    /// A decision is in the audit more than once.
    Repeated { reason: String, times: usize },
    /// A refused decision is in the audit.
    TakenThoughRefused { reason: String },
    /// Two decided the same thing.
    DecidedTwice { subject: String },
    /// A number of the audit is missing.
    AuditGap { before: i64 },
    /// The epoch of a robot did not go up with its owner.
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
    /// Two instances gave estimates in one epoch.
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

/// Estimates of an ended tenure that may come after one of the next: one that was on its way.
const LATE_ESTIMATES_MAX: usize = 1;

impl Evidence {
    /// What is wrong with it.
    pub fn violations(&self) -> Vec<Violation> {
        let mut found = self.of_decisions();
        found.extend(self.of_owners());
        found.extend(self.of_rows());
        found.extend(self.of_estimates());
        found.extend(self.of_documents());
        found
    }

    /// Estimates that came after one of a later tenure of the same robot, by robot and epoch.
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

    /// Who had each robot at the moment in which a row of it was committed.
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
