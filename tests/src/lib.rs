//! End-to-end tests: real processes, real Zenoh, real browser.
