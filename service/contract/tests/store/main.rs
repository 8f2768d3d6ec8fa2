//! The store as its callers see it, on whichever database it stands.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod certificates;
mod history;
mod records;
mod transaction;
