//! Limits of previews: of what robots send that are not registered yet.

use std::time::Duration;

/// Robots of which previews are kept at once.
pub const PREVIEWS_MAX: usize = 4;
/// Time for which messages are kept for a preview after the last request for it.
pub const PREVIEW_KEPT: Duration = Duration::from_secs(15);
/// Messages of one robot that wait for the next request; a further one pushes the oldest out.
pub const PREVIEW_MESSAGES_MAX: usize = 4_096;
/// Bytes of these messages.
pub const PREVIEW_BYTES_MAX: usize = 16 << 20;
