//! The fleet: one mailbox and one estimator task per robot.

mod cloud;
mod commanded;
mod cross_track;
pub mod decode;
pub mod document;
mod handle;
mod intake;
mod mailbox;
mod pairing;
mod plan;
mod pose;
mod reading;
mod robot;
mod tap;
mod task;
#[cfg(test)]
mod tests;
mod trial;
mod view;
mod watch;

pub use cloud::ScanSettings;
pub use cross_track::{BIN_WIDTH_M, BINS_PER_SIDE, CrossTrack, GENERATIONS_MAX, UsedValues};
pub use handle::{FleetHandle, FleetRefused, FleetSetup, Journal};
pub use intake::{Intake, Taken};
pub use pairing::PairingReport;
pub use pose::LatestPose;
pub use reading::ReadingSettings;
pub use tap::{TapReader, Tapped, Taps};
pub use view::{
    AnnouncedTopic, Connection, Counters, FleetCounters, HistoryEvent, LiveUpdate, RobotState,
    RobotView, ServiceEvent, ServiceEventKind, Stream, StreamView, Warning, WarningKind,
};
