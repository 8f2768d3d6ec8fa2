//! The `fleetcal` command.
fn main() {}
