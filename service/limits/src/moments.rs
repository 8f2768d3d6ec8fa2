//! Limits of the latest data of robots: in memory, and on disk as moments.

use std::time::Duration;

/// Time for which a robot's latest messages stay in memory, to be written when something happens.
pub const MOMENT_SPAN: Duration = Duration::from_secs(60);
/// Memory for a robot's latest messages, bytes: 60 s of a scanner of 1,000 beams at 10 Hz take 5 MB.
pub const MOMENT_BYTES_OF_ROBOT_MAX: usize = 8 * 1024 * 1024;
/// Memory for the latest messages of all robots, bytes, which those that send share equally.
pub const MOMENT_BYTES_MAX: usize = 128 * 1024 * 1024;
/// Smallest piece in which memory for a robot's latest messages is taken, bytes.
pub const MOMENT_CHUNK_BYTES: usize = 64 * 1024;
/// Estimates and events of a robot that stay in memory with its latest messages.
pub const MOMENT_FOUND_MAX: usize = 96;
/// Size that is assumed of each of them, bytes.
pub const MOMENT_FOUND_BYTES: usize = 2 * 1024;
/// Time after a moment of a robot within which nothing but a request writes another one.
pub const MOMENT_AGAIN_AFTER: Duration = Duration::from_secs(10);
/// Moments that wait for the writer; further ones are counted as lost.
pub const MOMENTS_WAITING_MAX: usize = 16;
/// Moments of a robot on disk; the oldest is dropped for a further one.
pub const MOMENTS_OF_ROBOT_MAX: usize = 20;
/// Size of a robot's moments on disk, bytes.
pub const MOMENTS_DISK_BYTES_OF_ROBOT_MAX: u64 = 64 * 1024 * 1024;
/// Size of all moments on disk, bytes; then the robot that takes most loses its oldest.
pub const MOMENTS_DISK_BYTES_MAX: u64 = 1024 * 1024 * 1024;
