//! People who approve one proposal at once over two to five instances.

use std::net::SocketAddr;
use std::sync::Barrier;

use fleetcal_tests::http::Answer;

use crate::checker::{Decision, Evidence, Outcome};
use crate::cluster::{Cluster, Parts};
use crate::decider::{Desk, Waiting};
use crate::progress::Progress;
use crate::records;
use crate::trial::desk;

/// Robots with decisions, one after the other.
const PARKED: usize = 4;

/// The instances; two to five of them race.
const INSTANCES: [&str; 5] = ["a", "b", "c", "d", "e"];

/// One proposal and its approvers.
struct Race<'r> {
    desk: &'r Desk,
    second: &'r str,
    robot: String,
    seed: u64,
}

impl Race<'_> {
    fn propose(&self, at: SocketAddr) -> Waiting {
        let proposed = self
            .desk
            .propose(at, &self.robot, &format!("race {}", self.seed));
        let proposed = proposed.unwrap();
        assert_eq!(proposed.status, 201, "{}", proposed.body);
        Desk::proposed(&proposed).unwrap()
    }

    /// Returns the instances of the approvals, as places in [`INSTANCES`]: two to five of them.
    fn racers(&self) -> Vec<usize> {
        let seed = self.seed as usize;
        let count = 2 + seed / PARKED % (INSTANCES.len() - 1);
        let first = seed % INSTANCES.len();
        let place = |racer| (first + racer) % INSTANCES.len();
        (0..count).map(place).collect()
    }

    /// Runs all approvals at once, each at an instance of its own and every other one by another
    /// person; returns their number, and the winning instance.
    fn run(&self, decisions: &mut Vec<Decision>) -> [usize; 2] {
        let racers = self.racers();
        let waiting = &self.propose(self.desk.instances[racers[0]]);
        let start = &Barrier::new(racers.len());
        let reason = |at: usize| format!("approve race {} at {}", self.seed, INSTANCES[at]);
        let answers: Vec<Answer> = std::thread::scope(|scope| {
            let ask = |(racer, &at): (usize, &usize)| {
                let approver = self.desk.approver.as_str();
                let token = [approver, self.second][racer % 2];
                let (instance, reason) = (self.desk.instances[at], reason(at));
                scope.spawn(move || {
                    start.wait();
                    Desk::approve(instance, token, waiting, &reason).unwrap()
                })
            };
            let asked: Vec<_> = racers.iter().enumerate().map(ask).collect();
            asked.into_iter().map(|one| one.join().unwrap()).collect()
        });
        for (answer, &at) in answers.iter().zip(&racers) {
            let (outcome, reason) = (outcome(answer), reason(at));
            decisions.push(Decision { reason, outcome });
        }
        let won = answers.iter().zip(&racers);
        let won: Vec<_> = won.filter(|(answer, _)| answer.status == 200).collect();
        let [(_, winner)] = won[..] else {
            panic!("race {}: {answers:?}", self.seed);
        };
        // The instance that took it knows it at once.
        let at = self.desk.instances[*winner];
        let back = self.desk.roll_back(at, &self.robot, "the next one follows");
        assert_eq!(
            back.as_ref().map(|answer| answer.status),
            Some(200),
            "{back:?}"
        );
        [racers.len(), *winner]
    }
}

fn outcome(answer: &Answer) -> Outcome {
    match answer.status {
        200 => Outcome::Acknowledged,
        409 | 412 => Outcome::Refused,
        other => panic!("{other}: {}", answer.body),
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn of_approvals_at_two_to_five_instances_exactly_one_wins() {
    let mut progress = Progress::of("race", 50);
    let open = progress.open();
    if !open.is_empty() {
        let parts = Parts {
            names: INSTANCES.to_vec(),
            robots: 0,
            parked: PARKED,
            robots_apply: false,
            fast_takeover: true,
            in_namespaces: false,
        };
        let cluster = Cluster::watched(&parts).await;
        let instances = INSTANCES.iter().enumerate();
        let instances = instances.map(|(place, name)| cluster.start(name, place % 2));
        let _instances: Vec<_> = instances.collect();
        let desk = desk(&cluster, &INSTANCES, "");
        let second = cluster.token_of("bruno");
        let mut evidence = Evidence::default();
        for seed in open {
            progress.begin(seed);
            let race = Race {
                desk: &desk,
                second: &second,
                robot: format!("parked_{}", seed % PARKED as u64 + 1),
                seed,
            };
            let [racers, winner] = race.run(&mut evidence.decisions);
            progress.passed(seed, vec![racers as f64, winner as f64]);
        }
        records::read(&cluster.database().parse().unwrap(), &mut evidence);
        assert_eq!(evidence.violations(), []);
    }
    println!(
        "approvals raced by 2 to 5 instances, with not exactly one that won, or other faults: {}",
        progress.told_failed()
    );
    let winners = progress.figures(1);
    let of_one = |winner: usize| {
        winners
            .iter()
            .filter(|one| **one as usize == winner)
            .count()
    };
    let each: Vec<_> = (0..INSTANCES.len()).map(of_one).collect();
    println!(
        "  {} attempts; won by {INSTANCES:?} {each:?} times; {}",
        progress.count(0),
        progress.told("as above")
    );
}
