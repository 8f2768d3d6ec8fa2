//! The store as its callers see it, on whichever database it stands.

mod history;
mod records;
mod transaction;
