//! Damaged inputs for every reader of what comes from outside.
//!
//! The harness is plain: a seed damages a genuine input, the reader may refuse it and may not
//! panic, nor take longer than [`READ_MAX`]. It runs on the project's own toolchain and in its own
//! tests, without a second, instrumented build of all dependencies; the price is that nothing
//! guides it to new paths but genuine inputs of each kind and the numbers and words at which readers
//! go wrong. A seed and a target reproduce an input. Inputs that failed stay in `found`.

pub mod mutation;
pub mod seeds;
pub mod targets;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use mutation::{Draw, damaged};
use targets::Target;

/// Longest time for one input: the readers' limits are far below.
pub const READ_MAX: Duration = Duration::from_secs(10);

/// Input that a reader did not stand.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Failure {
    /// Seed of the damage; `None` for a kept input.
    pub seed: Option<u64>,
    /// The input.
    pub input: Vec<u8>,
    /// Message of the failure.
    pub what: String,
}

/// Returns the folder of the inputs of a target that failed once.
pub fn found(target: &Target) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    root.join("found").join(target.name)
}

/// Returns the input of a seed.
pub fn input_of(seeds: &[Vec<u8>], seed: u64) -> Vec<u8> {
    damaged(seeds, &mut Draw::new(seed))
}

/// Reads one input; returns whether it was taken.
///
/// # Errors
/// The reader panicked, or took too long.
#[expect(
    clippy::disallowed_methods,
    reason = "a reader that hangs takes real time"
)]
pub fn try_one(
    target: &Target,
    seed: Option<u64>,
    input: &[u8],
    scratch: &Path,
) -> Result<bool, Failure> {
    let began = Instant::now();
    let read = catch_unwind(AssertUnwindSafe(|| (target.read)(input, scratch)));
    let failure = |what| Failure {
        seed,
        input: input.to_vec(),
        what,
    };
    let took = began.elapsed();
    match read {
        Err(panic) => {
            let said = panic.downcast_ref::<String>().cloned();
            let said = said.or_else(|| panic.downcast_ref::<&str>().map(|&text| text.to_owned()));
            Err(failure(format!("panicked: {}", said.unwrap_or_default())))
        }
        Ok(_) if took > READ_MAX => Err(failure(format!("took {took:?}"))),
        Ok(taken) => Ok(taken),
    }
}
