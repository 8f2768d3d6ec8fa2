//! The fleet: one mailbox and one estimator task per robot.

mod cloud;
pub mod decode;
pub mod document;
mod handle;
mod mailbox;
mod robot;
mod task;
#[cfg(test)]
mod tests;
mod view;
mod watch;

pub use cloud::ScanSettings;
pub use handle::{FleetHandle, FleetRefused, FleetSetup, Journal};
pub use view::{
    Connection, Counters, FleetCounters, HistoryEvent, LiveUpdate, RobotState, RobotView,
    ServiceEvent, ServiceEventKind, Stream, StreamView,
};
