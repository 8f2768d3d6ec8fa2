//! The instance that sends messages to webhooks is killed while it does.

use std::time::Duration;

use fleetcal_tests::http;
use fleetcal_tests::service::wait_for;
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use serde_json::json;

use crate::figures::spread;
use crate::progress::Progress;
use crate::receiver::{Receiver, proposed};
use crate::records;
use crate::trial::{BALANCED_WITHIN, SERVED_WITHIN, Trial};

/// Pause between two decisions: messages are sent faster than proposals are made.
const PAUSE: Duration = Duration::from_secs(1);
/// Longest time of a decision while nothing is disturbed.
const DECIDED_WITHIN: Duration = Duration::from_secs(3);

/// Registers a receiver; returns the number of decisions that may have been made before.
fn register(trial: &Trial, receiver: &Receiver) -> usize {
    let instance = trial.instances.values().next().unwrap();
    let body = json!({"url": receiver.url(), "events": ["proposal.waiting"]}).to_string();
    let token = Some(instance.token());
    let answer = http::send(
        instance.http,
        "POST /api/v1/webhooks",
        token,
        Some(("", &body)),
    );
    let answer = answer.unwrap();
    assert_eq!(answer.status, 201, "{}", answer.body);
    std::thread::sleep(DECIDED_WITHIN);
    trial.decider.decisions().len()
}

/// Kills the instance that sends while the receiver accepts a message; returns the time until
/// another one had this duty, and until all proposals were reported, s.
fn kill(trial: &mut Trial, receiver: &Receiver, from: usize, seed: u64) -> [f64; 2] {
    let mut random = StdRng::seed_from_u64(seed);
    std::thread::sleep(Duration::from_millis(random.random_range(2_000..4_000)));
    let url = trial.url();
    let [_, again_before] = receiver.counts();
    wait_for("a message", || receiver.is_accepting().then_some(()));
    let sends = records::holder(&url, "webhooks").expect("a sender");
    let name = *trial.instances.keys().find(|name| **name == sends).unwrap();
    let killed = trial.kill(name);
    wait_for("another sender", || {
        records::holder(&url, "webhooks").filter(|next| next != name)
    });
    let taken_over = killed.elapsed();
    let decided = trial.decider.decisions().split_off(from);
    wait_for("messages of all proposals", || {
        receiver.not_told(&decided).is_empty().then_some(())
    });
    let told = killed.elapsed();
    trial.start_again(name);
    let balanced = trial.balanced();
    assert!(balanced < BALANCED_WITHIN, "balanced after {balanced:?}");
    trial.check(seed);
    let [came, again] = receiver.counts();
    println!(
        "round {seed}: {name} killed, another has the duty after {taken_over:.2?}, all {} proposals told of \
         after {told:.2?}; so far {came} messages came, {again} again though they were taken",
        proposed(&decided).count()
    );
    assert!(again > again_before, "the kill came too late to be noticed");
    assert!(taken_over <= SERVED_WITHIN, "{taken_over:?}");
    [taken_over.as_secs_f64(), told.as_secs_f64()]
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn every_proposal_is_told_though_its_sender_is_killed() {
    let mut progress = Progress::of("webhooks", 3);
    let open = progress.open();
    if !open.is_empty() {
        let mut trial = Trial::start(true, open[0], PAUSE).await;
        let receiver = Receiver::start();
        let from = register(&trial, &receiver);
        for seed in open {
            progress.begin(seed);
            let took = kill(&mut trial, &receiver, from, seed);
            progress.passed(seed, took.to_vec());
        }
        println!(
            "webhooks: {}; {}",
            trial.seen(),
            progress.told(&trial.server())
        );
    }
    println!(
        "kill -9 of the instance that tells webhooks, until another one has the duty: {}",
        spread(&progress.figures(0))
    );
    println!("  until all is told: {}", spread(&progress.figures(1)));
    println!(
        "  with a proposal not told, or told in two ways, or other faults: {}",
        progress.told_failed()
    );
}
