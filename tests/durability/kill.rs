//! `kill -9` at random moments: nothing that was acknowledged is lost, and nothing is half done.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use tempfile::TempDir;

use crate::durability::place::Place;
use crate::durability::said::Said;
use crate::durability::witness::Witness;

/// Rounds of the suite; `KILL_ROUNDS` sets another number.
const ROUNDS: u64 = 300;
/// Rounds that continue with the same database.
const ROUNDS_OF_A_DATABASE: u64 = 15;

/// Time after the opening of its database within which a process is killed.
const KILLED_WITHIN: Duration = Duration::from_millis(60);
/// Time on a server, where a decision takes several times as long.
const KILLED_WITHIN_ON_SERVER: Duration = Duration::from_millis(400);

/// Database of one test: on a server if `FLEETCAL_TEST_POSTGRES` names one.
struct Database {
    address: String,
    killed_within: Duration,
    /// Folder, kept if there is a fault in it.
    folder: TempDir,
}

impl Database {
    async fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (address, killed_within) = match fleetcal_contract::server() {
            Some(server) => {
                let url = fleetcal_postgres::create_for_test(&server).await.unwrap();
                (url.to_string(), KILLED_WITHIN_ON_SERVER)
            }
            None => (folder.path().display().to_string(), KILLED_WITHIN),
        };
        Self {
            address,
            killed_within,
            folder,
        }
    }
}

fn decider(database: &str, seed: u64) -> Child {
    let seed = seed.to_string();
    let order = [seed.as_str(), "3", "1000000", "1", "power"];
    Command::new(env!("CARGO_BIN_EXE_fleetcal-decider"))
        .arg(database)
        .args(order)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Runs the process until it is killed at a random moment, and reads all its lines.
fn one_round(database: &Database, seed: u64, witness: &mut Witness) {
    let mut random = StdRng::seed_from_u64(seed);
    let mut child = decider(&database.address, seed);
    let out = BufReader::new(child.stdout.take().unwrap());
    // Some die before they are open, too.
    let early = random.random_range(0..10) == 0;
    let delay = random.random_range(Duration::ZERO..database.killed_within);
    let (opened, is_open) = std::sync::mpsc::sync_channel(1);
    let listener = std::thread::spawn(move || {
        let mut heard = Vec::new();
        for line in out.split(b'\n') {
            // The last line may be cut short: then nobody was told.
            let Ok(said) = serde_json::from_slice::<Said>(&line.unwrap()) else {
                break;
            };
            if said == Said::Opened {
                opened.send(()).unwrap();
            }
            heard.push(said);
        }
        heard
    });
    if !early {
        let opened = is_open.recv_timeout(Duration::from_mins(1));
        assert!(opened.is_ok(), "seed {seed}: {:?}", child.wait());
    }
    std::thread::sleep(delay);
    child.kill().unwrap();
    let ended = child.wait().unwrap();
    assert!(
        !ended.success() && ended.code().is_none(),
        "seed {seed}: {ended}"
    );
    for said in listener.join().unwrap() {
        witness.hear(said);
    }
}

#[tokio::test]
async fn a_killed_service_loses_nothing_that_it_acknowledged() {
    let rounds = std::env::var("KILL_ROUNDS").map_or(ROUNDS, |text| text.parse().unwrap());
    let base = std::env::var("KILL_SEED").map_or(1, |text| text.parse().unwrap());
    let (mut acknowledged, mut unheard) = (0, 0);
    let mut database = Database::new().await;
    let mut witness = Witness::default();
    for round in 0..rounds {
        if round % ROUNDS_OF_A_DATABASE == 0 {
            database = Database::new().await;
            witness = Witness::default();
        }
        let seed = base + round;
        one_round(&database, seed, &mut witness);
        match witness.check(&Place::of(&database.address)).await {
            Ok(records) => {
                acknowledged += witness.acknowledged;
                witness.acknowledged = 0;
                witness.settle(&records);
                unheard += witness.unheard;
                witness.unheard = 0;
            }
            Err(fault) => {
                database.folder.disable_cleanup(true);
                panic!("KILL_SEED={seed}, {}: {fault:?}", database.address);
            }
        }
    }
    println!(
        "{rounds} kills, {acknowledged} acknowledged decisions, 0 lost, 0 half applied; \
         {unheard} were committed and not yet acknowledged"
    );
    assert!(
        acknowledged as u64 > rounds,
        "{acknowledged} decisions are too few to tell"
    );
}
