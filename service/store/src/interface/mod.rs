//! Requests to the store, a file for each kind of record.

mod accounts;
mod alerts;
mod approvals;
mod certificates;
mod cluster;
mod policy;
mod rollouts;
mod webhooks;
