//! The data folder of a service: held by one process, with the signing key, and the database where
//! that is a file.

mod folder;
pub mod signing_key;

pub use folder::Folder;
