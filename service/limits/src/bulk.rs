//! Limits of requests about many robots.

/// Robots that one request acts on.
pub const ACTED_AT_ONCE_MAX: usize = 500;
/// Alerts of one robot that one request acknowledges.
pub const ACKNOWLEDGED_OF_ROBOT_MAX: usize = 16;
/// Decisions of one request that wait for the database together: they share a transaction.
pub const DECIDED_TOGETHER: usize = 32;
/// Robots that one request registers.
pub const REGISTERED_AT_ONCE_MAX: usize = 1_000;
/// Columns of a table of robots to register.
pub const IMPORT_COLUMNS_MAX: usize = 64;
/// Longest name of a column in a table of robots to register, in bytes.
pub const IMPORT_COLUMN_BYTES_MAX: usize = 64;
/// Parts of a column's name in a table of robots to register, with dots between them.
pub const IMPORT_COLUMN_PARTS_MAX: usize = 3;
/// Roll-outs that go on at once, running or paused; no further one is started.
pub const ROLLOUTS_RUNNING_MAX: u32 = 100;
/// Waves of a roll-out.
pub const ROLLOUT_WAVES_MAX: usize = 20;
/// Longest body of a request about many robots, in bytes.
pub const BULK_BODY_BYTES_MAX: usize = 2 * 1024 * 1024;
