//! Power loss: a recording of all that reaches the disk, replayed into thousands of disks as they
//! may be found after the power went. `kill -9` cannot show this: the page cache survives it.

use std::path::{Path, PathBuf};

use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

use crate::durability::disk::Disk;
use crate::durability::place::Place;
use crate::durability::said::Said;
use crate::durability::trace::{self, Event};
use crate::durability::witness::{Fault, Witness};

/// Disks that are examined with the settings of the service; `POWER_IMAGES` sets another number.
const IMAGES: usize = 500;
/// Disks that are examined with settings that survive the process alone.
const IMAGES_UNSAFE: usize = 200;
/// Decisions of a recording; the log is checkpointed into the database more than once meanwhile.
const DECISIONS: &str = "120";

/// Results of the images of one recording.
#[derive(Debug, Default)]
struct Found {
    images: usize,
    acknowledged: usize,
    lost: usize,
    other: Vec<String>,
}

/// Returns the folder of images: in memory, as their own durability is irrelevant.
fn images_in() -> PathBuf {
    let memory = Path::new("/dev/shm");
    if memory.is_dir() {
        memory.to_path_buf()
    } else {
        std::env::temp_dir()
    }
}

async fn lose_power_often(outlives: &str, images: usize, seed: u64) -> Found {
    let folder = tempfile::tempdir().unwrap();
    let seed_text = seed.to_string();
    let path = folder.path().to_str().unwrap();
    let order = [path, seed_text.as_str(), "3", DECISIONS, "2", outlives];
    let events = trace::record(
        env!("CARGO_BIN_EXE_fleetcal-decider"),
        &order,
        folder.path(),
    );
    let mut random = StdRng::seed_from_u64(seed);
    let mut cuts: Vec<_> = (0..images)
        .map(|_| random.random_range(1..=events.len()))
        .collect();
    cuts.sort_unstable();
    let mut found = Found {
        images,
        ..Found::default()
    };
    let (mut disk, mut witness, mut printed) = (Disk::default(), Witness::default(), Vec::new());
    let mut cuts = cuts.into_iter().peekable();
    for (number, event) in events.iter().enumerate() {
        disk.take(number, event);
        if let Event::Print(bytes) = event {
            printed.extend_from_slice(bytes);
            while let Some(end) = printed.iter().position(|byte| *byte == b'\n') {
                let line: Vec<u8> = printed.drain(..=end).collect();
                witness.hear(serde_json::from_slice::<Said>(&line).unwrap());
            }
        }
        while cuts.next_if_eq(&(number + 1)).is_some() {
            let image = tempfile::tempdir_in(images_in()).unwrap();
            disk.lose_power(&mut random, image.path());
            found.acknowledged += witness.acknowledged;
            match witness.check(&Place::Folder(image.path().to_owned())).await {
                Ok(_) => {}
                Err(Fault::Lost(_)) => found.lost += 1,
                Err(other) => found
                    .other
                    .push(format!("cut after event {number}: {other:?}")),
            }
        }
    }
    found
}

/// True if this machine can record. Without strace the test reports it, and fails where it must not
/// be left out.
fn can_record() -> bool {
    let Some(missing) = trace::missing() else {
        return true;
    };
    assert!(std::env::var_os("CI").is_none(), "{missing}");
    println!("skipped: {missing}");
    false
}

#[tokio::test]
async fn power_loss_takes_no_acknowledged_approval() {
    if !can_record() {
        return;
    }
    let seed = std::env::var("POWER_SEED").map_or(1, |text| text.parse().unwrap());
    let images = std::env::var("POWER_IMAGES").map_or(IMAGES, |text| text.parse().unwrap());
    let found = lose_power_often("power", images, seed).await;
    println!(
        "{} images, {} acknowledged decisions on average: {} lost some, {} are not sound",
        found.images,
        found.acknowledged / found.images,
        found.lost,
        found.other.len()
    );
    assert!(
        found.other.is_empty(),
        "POWER_SEED={seed}: {:#?}",
        found.other
    );
    assert_eq!(found.lost, 0, "POWER_SEED={seed}");
}

/// Shows that the test above can fail: without the sync of each commit the same images lose
/// approvals.
#[tokio::test]
async fn without_the_sync_of_each_commit_power_loss_takes_approvals() {
    if !can_record() {
        return;
    }
    let found = lose_power_often("process", IMAGES_UNSAFE, 1).await;
    println!("{} images, {} lost some", found.images, found.lost);
    assert!(found.lost > IMAGES_UNSAFE / 10, "{found:?}");
}
