//! The fleet: one mailbox and one estimator task per robot.

mod handle;
mod mailbox;
mod robot;
mod view;

pub use handle::{FleetHandle, FleetRefused, FleetSetup, Journal};
pub use mailbox::{PayloadFormat, Progress};
pub use view::{
    Connection, Counters, FleetCounters, HistoryEvent, LiveUpdate, RobotState, RobotView,
    ServiceEvent, ServiceEventKind, Stream, StreamView,
};
