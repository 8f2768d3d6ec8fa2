//! End-to-end tests: real processes, real Zenoh, real browser.
//!
//! Here is what they share: the built binary, a running service, and recordings.

#![expect(
    clippy::expect_used,
    clippy::panic,
    reason = "a test that cannot go on fails"
)]

pub mod binary;
pub mod certificates;
pub mod clouds;
pub mod database;
pub mod http;
pub mod memory;
pub mod odometry;
pub mod recording;
pub mod replayed;
pub mod report;
pub mod rewritten;
pub mod rosbags;
pub mod service;
