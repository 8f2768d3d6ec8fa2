//! The fleet: one mailbox and one estimator task per robot.

pub mod budget;
mod budgets;
mod candidate;
mod cloud;
mod coarse_stamps;
mod commanded;
mod cross_track;
pub mod decode;
pub mod document;
mod handle;
mod intake;
pub mod live;
mod mailbox;
mod packed;
mod pairing;
mod peers;
mod pose;
mod reading;
mod registry;
mod report;
mod robot;
mod running;
mod senders;
mod stored;
mod tap;
mod task;
mod tenancy;
#[cfg(test)]
mod tests;
mod top_view;
mod verification_run;
mod watch;
pub mod words;

pub use cross_track::UsedValues;
pub use handle::{Arrived, FleetHandle, FleetRefused, FleetSetup};
pub use intake::{Intake, Taken};
pub use packed::FORMAT_READ_MAX as CHECKPOINT_FORMAT_READ_MAX;
pub use peers::{PeerSessions, SessionClosed};
pub use pose::LatestPose;
pub use reading::ReadingSettings;
pub use registry::FleetCounters;
pub use report::{Digest, ReportDetails, Reported, RobotReport};
pub use senders::Origin;
pub use stored::estimator_of;
pub use tap::{TapReader, Tapped, Taps};
pub use tenancy::Keep;
