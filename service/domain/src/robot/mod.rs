//! Robots as the whole service describes them: configuration, view and history. Below every module
//! that decides, stores, shows or sends.

mod basis;
mod checks;
mod config;
mod cross_track;
mod described;
mod history;
mod own_settings;
mod view;

pub use basis::{Basis, Signals};
pub use checks::{CheckFinding, CheckState, CheckedStream, ChecksReport, LeftOut};
pub use config::{
    MOUNT_MAX_M, Mount, RobotConfig, ScanSettings, ValueRefused, WHEELBASE_MAX_M,
    WheelOdometrySignal, Wheelbase,
};
pub use cross_track::{BIN_WIDTH_M, BINS_PER_SIDE, CrossTrack, GENERATIONS_MAX};
pub use described::DescribedConfig;
pub use history::{HistoryEvent, Journal, ServiceEvent, ServiceEventKind};
pub use own_settings::OwnSettings;
pub use view::{
    AnnouncedTopic, Connection, ConnectionState, Counters, PairingReport, RobotState, RobotView,
    StreamView, Warning, WarningKind,
};
