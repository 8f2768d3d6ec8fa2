//! Growth of database and log by a flood of each kind, beside what the fleet itself writes.
//! `make hardening-growth`; `GROWTH_MINUTES` and `GROWTH_KINDS` shorten it.

use super::flood_kinds::KINDS;
use super::floods::{List, flooded};

/// Default duration of each flood, min; `GROWTH_MINUTES` sets another.
const MINUTES: u64 = 60;
/// Largest growth of either by a flood in an hour, bytes. The budgets that bound it are hourly: a
/// shorter flood adds as much as an hour's.
const BEYOND_MAX_BYTES: u64 = 1_000_000;

#[test]
#[ignore = "nine hours; make hardening-growth"]
fn floods_add_little_to_database_and_log() {
    let asked = std::env::var("GROWTH_MINUTES").ok();
    let minutes = asked.map_or(MINUTES, |text| text.parse().unwrap());
    let kinds = std::env::var("GROWTH_KINDS").unwrap_or_else(|_| KINDS.join(" "));
    let control = flooded(List::Default, None, minutes * 60);
    println!(
        "nothing, {minutes} min: database +{} kB, log +{} kB",
        control.database_bytes / 1_000,
        control.log_bytes / 1_000
    );
    let mut missed = Vec::new();
    for kind in kinds.split_whitespace() {
        let figures = flooded(List::Default, Some(kind), minutes * 60);
        assert!(figures.done > 100, "that was no flood: {figures:?}");
        let database = figures
            .database_bytes
            .saturating_sub(control.database_bytes);
        let log = figures.log_bytes.saturating_sub(control.log_bytes);
        println!(
            "{kind} ({}), {minutes} min: database +{} kB, log +{} kB, {} and {} kB beyond",
            figures.done,
            figures.database_bytes / 1_000,
            figures.log_bytes / 1_000,
            database / 1_000,
            log / 1_000
        );
        if database.max(log) > BEYOND_MAX_BYTES {
            missed.push(kind);
        }
    }
    assert!(
        missed.is_empty(),
        "beyond {BEYOND_MAX_BYTES} bytes: {missed:?}"
    );
}
