//! Two people who approve one proposal at once over two instances.

use std::net::SocketAddr;

use fleetcal_tests::http::Answer;

use crate::checker::{Decision, Evidence, Outcome};
use crate::cluster::{Cluster, Parts};
use crate::decider::{Desk, Waiting};
use crate::figures::told;
use crate::progress::Progress;
use crate::records;
use crate::trial::desk;

/// Robots about which is decided, one after the other.
const PARKED: usize = 4;

/// One proposal and the two who approve it.
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

    /// Both at once, each at an instance of its own; who won.
    fn run(&self, decisions: &mut Vec<Decision>) -> usize {
        let [a, b] = [self.desk.instances[0], self.desk.instances[1]];
        let waiting = self.propose(if self.seed.is_multiple_of(2) { a } else { b });
        let attempts = [(a, self.desk.approver.as_str(), "a"), (b, self.second, "b")];
        let reason = |of: &str| format!("approve race {} at {of}", self.seed);
        let answers: Vec<Answer> = std::thread::scope(|scope| {
            let ask = |(at, token, of)| {
                let waiting = &waiting;
                scope.spawn(move || Desk::approve(at, token, waiting, &reason(of)).unwrap())
            };
            let asked = attempts.map(ask);
            asked.map(|one| one.join().unwrap()).into()
        });
        let won: Vec<_> = answers.iter().map(|answer| answer.status == 200).collect();
        for (answer, (_, _, of)) in answers.iter().zip(attempts) {
            let (outcome, reason) = (outcome(answer), reason(of));
            decisions.push(Decision { reason, outcome });
        }
        assert_eq!(won.iter().filter(|won| **won).count(), 1, "{answers:?}");
        let winner = usize::from(won[1]);
        // The instance that took it knows it at once.
        let back = self
            .desk
            .roll_back([a, b][winner], &self.robot, "the next one follows");
        assert_eq!(
            back.as_ref().map(|answer| answer.status),
            Some(200),
            "{back:?}"
        );
        winner
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
async fn of_two_approvals_at_two_instances_exactly_one_wins() {
    let mut progress = Progress::of("races", 50);
    let open = progress.open();
    if !open.is_empty() {
        let names = vec!["a", "b"];
        let parts = Parts {
            names: names.clone(),
            robots: 0,
            parked: PARKED,
            fast_takeover: true,
        };
        let cluster = Cluster::watched(&parts).await;
        let _instances = [cluster.start("a", 0), cluster.start("b", 1)];
        let desk = desk(&cluster, &names);
        let second = cluster.token_of("bruno");
        let mut evidence = Evidence::default();
        for seed in open {
            let race = Race {
                desk: &desk,
                second: &second,
                robot: format!("parked_{}", seed % PARKED as u64 + 1),
                seed,
            };
            let winner = race.run(&mut evidence.decisions);
            progress.passed(seed, vec![winner as f64]);
        }
        records::read(&cluster.database().parse().unwrap(), &mut evidence);
        assert_eq!(evidence.violations(), []);
    }
    let (rounds, by_b) = (progress.len(), progress.count(0));
    println!(
        "approvals raced by two instances, not exactly one won: {}",
        told(0, rounds)
    );
    println!(
        "  won by a {}, by b {by_b}; {}",
        rounds - by_b,
        progress.told("as above")
    );
}
