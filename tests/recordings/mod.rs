//! Tests on recordings of real robots, and on those that figures are quoted for: `make
//! test-recordings`. Every test finds them in the folder that `FLEETCAL_DATA` names, and says that
//! it was skipped where that is not set.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod calibrate;
mod decode;
mod doctor;
mod error;
mod odometry;
mod one_sided;
mod poles;
mod recorded;
mod repeatability;
mod replay;
