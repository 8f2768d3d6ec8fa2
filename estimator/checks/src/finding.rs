//! Findings, and the patience that a cause needs before it is named.

use crate::cause::{Cause, Check, Held};

/// State of a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// Evidence that goes together.
    Ok,
    /// Cause that is named.
    Wrong,
    /// Evidence with more than one explanation.
    Unsure,
    /// Evidence that is too little so far.
    NotYet,
}

impl State {
    /// State of the check that names a cause.
    const fn of(cause: Cause) -> Self {
        if cause.row().certain {
            Self::Wrong
        } else {
            Self::Unsure
        }
    }

    /// Its name: `ok`, `wrong`, `unsure` or `not_yet`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Wrong => "wrong",
            Self::Unsure => "unsure",
            Self::NotYet => "not_yet",
        }
    }
}

/// Result of a check.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// The check.
    pub check: Check,
    /// Its state.
    pub state: State,
    /// The cause that is named, where one is.
    pub cause: Option<Cause>,
    /// Evidence with numbers; the missing motion of a check that has no result yet.
    pub seen: String,
    /// The LiDAR's way until the cause was named, m.
    pub after_m: f64,
    /// Time until the cause was named, from the first message, s.
    pub after_s: f64,
}

impl Finding {
    /// A cause that was named before, by another run of the checks.
    pub fn named_before(cause: Cause, seen: String) -> Self {
        let row = cause.row();
        Self {
            check: row.check,
            state: State::of(cause),
            cause: Some(cause),
            seen,
            after_m: 0.0,
            after_s: 0.0,
        }
    }

    /// Returns the remedy, if a cause is named.
    pub fn advice(&self) -> Option<&'static str> {
        self.cause.map(Cause::advice)
    }
}

/// Cause that the evidence of one look points to.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Suspicion {
    pub cause: Cause,
    pub seen: String,
}

impl Suspicion {
    pub fn new(cause: Cause, seen: String) -> Self {
        Self { cause, seen }
    }
}

/// Place and time of a look.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Moment {
    pub way_m: f64,
    pub time_s: f64,
}

/// A cause since it is suspected.
#[derive(Debug, Clone)]
struct Suspected {
    cause: Cause,
    since: Moment,
    seen: String,
    /// Moment of its naming.
    named: Option<Moment>,
}

/// Causes that are suspected or named. There is at most one entry a cause.
#[derive(Debug, Clone, Default)]
pub(crate) struct Patience {
    suspected: Vec<Suspected>,
}

impl Patience {
    /// Adds the suspicions of one look at some checks. A cause of these checks that is not among
    /// them is forgotten, unless it is named already and does not end.
    pub fn look(&mut self, now: Moment, looked_at: impl Fn(Cause) -> bool, found: Vec<Suspicion>) {
        let is_found = |cause| found.iter().any(|one| one.cause == cause);
        self.suspected.retain(|one| {
            let stays = one.named.is_some() && !one.cause.ends();
            stays || !looked_at(one.cause) || is_found(one.cause)
        });
        for Suspicion { cause, seen } in found {
            let known = self.suspected.iter_mut().find(|one| one.cause == cause);
            let Some(known) = known else {
                self.suspected.push(Suspected {
                    cause,
                    since: now,
                    seen,
                    named: is_due(cause, now, now).then_some(now),
                });
                continue;
            };
            known.seen = seen;
            if known.named.is_none() && is_due(cause, known.since, now) {
                known.named = Some(now);
            }
        }
        self.suspected.sort_by_key(|one| one.cause.index());
    }

    /// Returns `true` if a cause is suspected that is not named yet.
    pub fn suspects(&self) -> bool {
        self.suspected.iter().any(|one| one.named.is_none())
    }

    /// Causes that are named.
    pub fn named(&self) -> impl Iterator<Item = Finding> {
        self.suspected.iter().filter_map(|one| {
            let named = one.named?;
            let row = one.cause.row();
            Some(Finding {
                check: row.check,
                state: State::of(one.cause),
                cause: Some(one.cause),
                seen: one.seen.clone(),
                after_m: named.way_m,
                after_s: named.time_s,
            })
        })
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        let texts: usize = self.suspected.iter().map(|one| one.seen.capacity()).sum();
        self.suspected.capacity() * size_of::<Suspected>() + texts
    }
}

fn is_due(cause: Cause, since: Moment, now: Moment) -> bool {
    match cause.row().held {
        Held::Seconds(seconds) => now.time_s - since.time_s >= seconds,
        Held::Metres(metres) => now.way_m - since.way_m >= metres,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(way_m: f64) -> Moment {
        Moment {
            way_m,
            time_s: way_m,
        }
    }

    #[test]
    fn a_cause_is_named_once_it_was_seen_at_every_look_over_ten_metres() {
        let mut patience = Patience::default();
        let mut look = |way_m: f64, seen: bool| {
            let found = seen.then(|| Suspicion::new(Cause::SteeringSign, String::new()));
            patience.look(at(way_m), |_| true, found.into_iter().collect());
            patience.named().count()
        };
        let named = [
            (0.0, true),
            (8.0, true),
            (9.0, false),
            (10.0, true),
            (19.0, true),
        ];
        assert!(
            named
                .into_iter()
                .all(|(way_m, seen)| look(way_m, seen) == 0)
        );
        assert_eq!(look(20.0, true), 1);
        // What was named stays.
        assert_eq!(look(30.0, false), 1);
    }

    #[test]
    fn a_look_at_other_checks_forgets_nothing() {
        let mut patience = Patience::default();
        let found = |cause| vec![Suspicion::new(cause, String::new())];
        patience.look(at(0.0), |_| true, found(Cause::SpeedUnit));
        patience.look(at(5.0), |cause| cause.check() == Check::Scan, Vec::new());
        patience.look(at(10.0), |_| true, found(Cause::SpeedUnit));
        assert_eq!(patience.named().count(), 1);
    }
}
