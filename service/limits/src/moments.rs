//! Limits of recordings of robots: live ones, and the latest data in memory and on disk as moments.

use std::time::Duration;

/// Time for which a robot's latest messages stay in memory, to be written when something happens.
pub const MOMENT_SPAN: Duration = Duration::from_mins(1);
/// Memory for a robot's latest messages, bytes: 60 s of a scanner of 1,000 beams at 10 Hz take 5 MB.
pub const MOMENT_BYTES_OF_ROBOT_MAX: usize = 8 * 1024 * 1024;
/// Memory for the latest messages of all robots, bytes, which those that send share equally; at most
/// the [`MOMENT_MEMORY_PARTS`]th part of what the process may use.
pub const MOMENT_BYTES_MAX: usize = 128 * 1024 * 1024;
/// Parts of the memory that the process may use, of which the latest messages take one at most.
pub const MOMENT_MEMORY_PARTS: u64 = 4;
/// Piece in which memory for a robot's latest messages is taken, bytes; less where a quarter of its
/// share is less.
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
/// Size of all moments on disk, bytes; then of the robots with several the one that takes most loses
/// its oldest, or else the oldest of all is dropped.
pub const MOMENTS_DISK_BYTES_MAX: u64 = 1024 * 1024 * 1024;
/// Recordings of robots that are made at once.
pub const RECORDINGS_MAX: usize = 8;
/// Items that wait for the writer of a recording.
pub const RECORDING_WAITING_MAX: usize = 4_096;
/// Bytes of the robot's messages that wait for the writer of a recording.
pub const RECORDING_WAITING_BYTES_MAX: usize = 16 * 1024 * 1024;
/// Longest recording of a robot, s.
pub const RECORDING_DURATION_MAX_S: u32 = 3_600;
/// Default length of a recording of a robot, s.
pub const RECORDING_DURATION_DEFAULT_S: u32 = 60;
/// Size at which a recording ends, bytes.
pub const RECORDING_BYTES_MAX: u64 = 1024 * 1024 * 1024;
/// Pieces of a recording that wait for the client that fetches it.
pub const RECORDING_PIECES_WAITING_MAX: usize = 4;
/// Stall after which a download is aborted.
pub const RECORDING_STALLED_AFTER: Duration = Duration::from_secs(30);
/// Time within which the client has to receive the rest of a recording after its end.
pub const RECORDING_REST_TAKEN_WITHIN: Duration = Duration::from_secs(30);
