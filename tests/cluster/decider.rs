//! Somebody who decides all the time over any instance: proposes, approves and takes back for
//! robots that do not drive, and notes how each decision ended.

use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use fleetcal_tests::http::{self, Answer};
use fleetcal_tests::service::now;
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use serde_json::{Value, json};

use crate::checker::{Decision, Outcome};

/// Most repetitions of an unanswered decision.
const TRIES_MAX: u32 = 8;
/// Pause before a repetition.
const AGAIN_AFTER: Duration = Duration::from_millis(200);

/// Addresses and identities for decisions.
#[derive(Debug, Clone)]
pub struct Desk {
    /// Addresses of the instances' APIs.
    pub instances: Vec<SocketAddr>,
    /// Token of the person who proposes and withdraws.
    pub proposer: String,
    /// Token of the approver.
    pub approver: String,
}

/// A waiting proposal.
#[derive(Debug, Clone)]
pub struct Waiting {
    id: u64,
    version: u64,
    sha256: String,
}

/// Returns the proposed values.
fn values() -> Value {
    json!({"steering_offset_rad": 0.02, "lidar_x_m": 0.43, "lidar_y_m": 0.01, "lidar_yaw_rad": 0.01})
}

/// Returns the outcome of a decision by its answer. One that the database may have taken is 503.
fn outcome(answer: Option<&Answer>) -> Outcome {
    match answer.map(|answer| answer.status) {
        Some(200..300) => Outcome::Acknowledged,
        // Too much was changed at that instance: another one may take it.
        Some(429) => Outcome::Unknown,
        Some(400..500) => Outcome::Refused,
        _ => Outcome::Unknown,
    }
}

impl Desk {
    /// Proposes at an instance; the key makes a repetition harmless.
    pub fn propose(&self, at: SocketAddr, robot: &str, reason: &str) -> Option<Answer> {
        let body = json!({"robot": robot, "values": values(), "reason": reason}).to_string();
        let key = format!("Idempotency-Key: {}\r\n", reason.replace(' ', "-"));
        let content = Some((key.as_str(), body.as_str()));
        http::send(at, "POST /api/v1/proposals", Some(&self.proposer), content)
    }

    /// Approves a proposal at an instance, with a token.
    pub fn approve(at: SocketAddr, token: &str, one: &Waiting, reason: &str) -> Option<Answer> {
        let request = format!("POST /api/v1/proposals/{}/approve", one.id);
        let body = json!({"sha256": one.sha256, "reason": reason}).to_string();
        let version = format!("If-Match: \"{}\"\r\n", one.version);
        http::send(at, &request, Some(token), Some((&version, &body)))
    }

    /// Withdraws the calibration in progress.
    pub fn roll_back(&self, at: SocketAddr, robot: &str, reason: &str) -> Option<Answer> {
        let token = Some(self.proposer.as_str());
        let shadow = http::get(at, &format!("/api/v1/robots/{robot}/shadow"), token)?;
        let shadow: Value = serde_json::from_str(&shadow.body).ok()?;
        let version = format!("If-Match: \"{}\"\r\n", shadow["version"]);
        let body = json!({"reason": reason}).to_string();
        let request = format!("POST /api/v1/robots/{robot}/rollback");
        http::send(at, &request, token, Some((&version, &body)))
    }

    /// Returns the proposal in an answer.
    pub fn proposed(answer: &Answer) -> Option<Waiting> {
        Self::waiting(&serde_json::from_str(&answer.body).ok()?)
    }

    /// Reads a proposal from its form in the API.
    pub fn waiting(proposal: &Value) -> Option<Waiting> {
        Some(Waiting {
            id: proposal["id"].as_u64()?,
            version: proposal["version"].as_u64()?,
            sha256: proposal["revision"]["sha256"].as_str()?.to_owned(),
        })
    }
}

/// Decisions so far, with the times of their acknowledgement.
#[derive(Debug, Default)]
struct Log {
    decisions: Vec<Decision>,
    acknowledged_at: Vec<Instant>,
    refusals: Vec<String>,
}

/// Threads that make decisions until this value is dropped.
#[derive(Debug)]
pub struct Decider {
    log: Arc<Mutex<Log>>,
    stop: Arc<AtomicBool>,
}

impl Decider {
    /// Begins to make decisions at each desk about a parked robot of its own, one after another
    /// with this pause.
    pub fn start(desks: Vec<Desk>, seed: u64, pause: Duration) -> Self {
        let (log, stop) = (Arc::<Mutex<Log>>::default(), Arc::<AtomicBool>::default());
        for (robot, desk) in (1_u64..).zip(desks) {
            let seed = seed * 100 + robot;
            let mut work = Work {
                desk,
                seed,
                random: StdRng::seed_from_u64(seed),
                log: Arc::clone(&log),
                count: 0,
                stop: Arc::clone(&stop),
            };
            std::thread::spawn(move || {
                while !work.stop.load(Ordering::Relaxed) {
                    work.decide_about(&format!("parked_{robot}"), pause);
                }
            });
        }
        Self { log, stop }
    }

    /// Returns the decisions so far.
    pub fn decisions(&self) -> Vec<Decision> {
        self.log.lock().unwrap().decisions.clone()
    }

    /// Returns the number of acknowledged decisions so far.
    pub fn acknowledged(&self) -> usize {
        self.log.lock().unwrap().acknowledged_at.len()
    }

    /// Returns the first acknowledgement since then.
    pub fn acknowledged_since(&self, then: Instant) -> Option<Instant> {
        let log = self.log.lock().unwrap();
        log.acknowledged_at.iter().copied().find(|at| *at >= then)
    }

    /// Returns the longest time since then without an acknowledgement.
    pub fn longest_pause(&self, then: Instant) -> Duration {
        let log = self.log.lock().unwrap();
        let since = log.acknowledged_at.iter().filter(|at| **at >= then);
        let moments: Vec<_> = [&then]
            .into_iter()
            .chain(since)
            .copied()
            .chain([now()])
            .collect();
        let pauses = moments.iter().zip(&moments[1..]);
        pauses
            .map(|(one, next)| next.saturating_duration_since(*one))
            .max()
            .unwrap_or_default()
    }

    /// Returns the latest reasons for which decisions were refused.
    pub fn refusals(&self) -> Vec<String> {
        let log = self.log.lock().unwrap();
        let latest = log.refusals.len().saturating_sub(5);
        log.refusals[latest..].to_vec()
    }
}

impl Drop for Decider {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

#[derive(Debug)]
struct Work {
    desk: Desk,
    seed: u64,
    random: StdRng,
    log: Arc<Mutex<Log>>,
    count: u64,
    stop: Arc<AtomicBool>,
}

impl Work {
    /// Makes a proposal, approves it, and withdraws it, each at any instance.
    fn decide_about(&mut self, robot: &str, pause: Duration) {
        std::thread::sleep(pause);
        let asked = |work: &Self, at, reason: &str| work.desk.propose(at, robot, reason);
        let proposed = self.decide("propose", true, asked);
        let Some(waiting) = proposed.as_ref().and_then(Desk::proposed) else {
            return self.give_way(robot, pause);
        };
        std::thread::sleep(pause);
        let approver = self.desk.approver.clone();
        let asked = |_: &Self, at, reason: &str| Desk::approve(at, &approver, &waiting, reason);
        self.decide("approve", false, asked);
        self.give_way(robot, pause);
    }

    fn give_way(&mut self, robot: &str, pause: Duration) {
        std::thread::sleep(pause);
        let asked = |work: &Self, at, reason: &str| work.desk.roll_back(at, robot, reason);
        self.decide("roll back", false, asked);
    }

    /// Repeats a request until it is answered, if that is harmless; records its outcome, and
    /// returns the answer if the decision was taken.
    fn decide(
        &mut self,
        what: &str,
        repeats: bool,
        ask: impl Fn(&Self, SocketAddr, &str) -> Option<Answer>,
    ) -> Option<Answer> {
        self.count += 1;
        let reason = format!("{what} {} {}", self.seed, self.count);
        let mut tries = 0;
        let answer = loop {
            let chosen = self.random.random_range(0..self.desk.instances.len());
            let answer = ask(self, self.desk.instances[chosen], &reason);
            tries += 1;
            let is_open = outcome(answer.as_ref()) == Outcome::Unknown;
            let stops = self.stop.load(Ordering::Relaxed);
            if !is_open || !repeats || tries >= TRIES_MAX || stops {
                break answer;
            }
            std::thread::sleep(AGAIN_AFTER);
        };
        let mut outcome = outcome(answer.as_ref());
        // What was asked for twice may have been taken by the first.
        if tries > 1 && outcome == Outcome::Refused {
            outcome = Outcome::Unknown;
        }
        let mut log = self.log.lock().unwrap();
        match (&answer, outcome) {
            (_, Outcome::Acknowledged) => log.acknowledged_at.push(now()),
            (Some(answer), _) => log.refusals.push(format!("{reason}: {}", answer.body)),
            (None, _) => log.refusals.push(format!("{reason}: no answer")),
        }
        log.decisions.push(Decision { reason, outcome });
        answer.filter(|_| outcome == Outcome::Acknowledged)
    }
}
