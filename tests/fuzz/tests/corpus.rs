//! Genuine inputs, inputs that failed once, and the first seeds of each target.

#![expect(clippy::panic, reason = "a test that cannot go on fails")]

use fleetcal_fuzz::mutation::Draw;
use fleetcal_fuzz::targets::{TARGETS, Target};
use fleetcal_fuzz::{found, input_of, try_one};

/// Asserts that a reader stands an input; returns whether it took it.
fn stands(target: &Target, seed: Option<u64>, input: &[u8], scratch: &std::path::Path) -> bool {
    try_one(target, seed, input, scratch)
        .unwrap_or_else(|failure| panic!("{} {seed:?}: {}", target.name, failure.what))
}

#[test]
fn readers_take_genuine_inputs_and_stand_those_that_failed_once() {
    for target in &TARGETS {
        let scratch = tempfile::tempdir().unwrap();
        let seeds = (target.seeds)();
        assert!(!seeds.is_empty(), "{} has no inputs", target.name);
        for (number, input) in seeds.iter().enumerate() {
            let is_taken = stands(target, None, input, scratch.path());
            assert!(is_taken, "{}: input {number} is not genuine", target.name);
        }
        let Ok(files) = std::fs::read_dir(found(target)) else {
            continue;
        };
        for file in files {
            let input = std::fs::read(file.unwrap().path()).unwrap();
            stands(target, None, &input, scratch.path());
        }
    }
}

#[test]
fn readers_refuse_damaged_inputs_without_a_panic() {
    for target in &TARGETS {
        let scratch = tempfile::tempdir().unwrap();
        let seeds = (target.seeds)();
        let tried = (0..target.quick).filter(|&seed| {
            let input = input_of(&seeds, seed);
            stands(target, Some(seed), &input, scratch.path())
        });
        println!(
            "{}: {} of {} taken",
            target.name,
            tried.count(),
            target.quick
        );
    }
}

#[test]
fn a_seed_makes_the_same_input_and_damages_most() {
    let seeds = (TARGETS[0].seeds)();
    let damaged = |seed| !seeds.contains(&input_of(&seeds, seed));
    assert_eq!(input_of(&seeds, 5), input_of(&seeds, 5));
    assert!((0..100).filter(|&seed| damaged(seed)).count() > 80);
    assert_ne!(Draw::new(1).number(), Draw::new(2).number());
}

#[test]
fn a_reader_that_panics_is_found() {
    let target = Target {
        read: |input, _| {
            assert!(input.is_empty(), "not empty");
            true
        },
        ..TARGETS[0]
    };
    let folder = tempfile::tempdir().unwrap();
    let failure = try_one(&target, Some(3), b"x", folder.path()).unwrap_err();
    assert_eq!(
        (failure.seed, failure.input.as_slice()),
        (Some(3), &b"x"[..])
    );
    assert!(failure.what.contains("not empty"), "{}", failure.what);
}
