//! Waiting of tests for a condition of something that runs beside them: a task, a session or a
//! process.
//!
//! A test that sleeps for a guessed time is too slow on a fast machine and wrong on a slow one.

use std::time::Duration;

use tokio::time::{sleep, timeout};

/// Time after which a condition is taken for one that will not come: longer than a calibration
/// takes from the first metre to its proof, on a machine that compiles beside the tests.
pub const PATIENCE: Duration = Duration::from_secs(200);
/// Interval between two looks at a condition.
const LOOK_EVERY: Duration = Duration::from_millis(10);

/// Waits until a condition holds, at most [`PATIENCE`].
///
/// # Panics
/// When it does not hold by then, naming it.
pub async fn until(condition: &str, mut holds: impl FnMut() -> bool) {
    until_answered(condition, async || holds()).await;
}

/// Waits until a condition holds that has to be asked for, at most [`PATIENCE`].
///
/// # Panics
/// When it does not hold by then, naming it.
pub async fn until_answered(condition: &str, mut holds: impl AsyncFnMut() -> bool) {
    let looks = async {
        while !holds().await {
            sleep(LOOK_EVERY).await;
        }
    };
    let waited = timeout(PATIENCE, looks).await;
    assert!(waited.is_ok(), "waited in vain until {condition}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn a_condition_is_waited_for_until_it_holds() {
        let mut looks = 0;
        until("the third look", || {
            looks += 1;
            looks == 3
        })
        .await;
        assert_eq!(looks, 3);
    }

    #[tokio::test(start_paused = true)]
    #[should_panic(expected = "in vain until it rains upwards")]
    async fn a_condition_that_never_holds_is_named() {
        until("it rains upwards", || false).await;
    }
}
