//! Limits of what a support bundle has of a robot.

/// Log lines of a robot that stay in memory.
pub const LOG_LINES_OF_ROBOT_MAX: usize = 100;
/// Longest part of a log line that stays in memory, bytes.
pub const LOG_LINE_BYTES_MAX: usize = 512;
/// Robots of which log lines stay in memory.
pub const LOG_LINES_ROBOTS_MAX: usize = 512;
/// Largest document of a support bundle, bytes.
pub const SUPPORT_DOCUMENT_BYTES_MAX: usize = 8 * 1024 * 1024;
