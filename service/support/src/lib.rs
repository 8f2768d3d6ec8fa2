//! Support bundles: what somebody needs who looks into a robot's trouble elsewhere, as one archive.
//!
//! A bundle is made of what its reader may read one by one: documents of the API, log lines and
//! moments. Nothing that holds a secret (a password, token, key or webhook's address) is a part.

mod archive;
mod log_lines;

pub use archive::Archive;
pub use log_lines::{Remembering, lines_of};
