//! The fleetcal service: Zenoh link, one estimator task per robot, store, HTTP API and dashboard.
//!
//! The data go one way: `link` (key, size, count) puts a message into its robot's bounded mailbox;
//! the robot's task in [`fleet`] decodes it and feeds the pure estimator; what the estimator asks
//! for is done: history to `store`, live updates to `api`'s event stream, the estimate to `link`.
//!
//! Exactly one module knows each outside world: `link` knows zenoh, `store` sqlx, `api` axum.

pub mod access;
pub mod alert;
pub mod api;
pub mod approval;
pub mod clerk;
pub mod clock;
pub mod command;
pub mod config;
pub mod courier;
pub mod entropy;
pub mod fleet;
pub mod limits;
pub mod link;
pub mod map_server;
pub mod public_url;
pub mod sentry;
pub mod service;
pub mod session_export;
pub mod signing_key;
pub mod store;
pub mod streams;
pub mod webhook;
mod words;
