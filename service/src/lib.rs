//! The fleetcal service: Zenoh link, one estimator task per robot, store, HTTP API and dashboard.
