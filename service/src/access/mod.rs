//! Who may do what: roles and actors. Pure.

mod actor;
mod role;

pub use actor::{Actor, Authentication};
pub use role::Role;
