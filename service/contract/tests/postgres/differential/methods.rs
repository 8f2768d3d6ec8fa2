//! Methods of the traits, read out of the sources, and those that were called.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

/// Number of calls of each method.
#[derive(Debug, Clone, Default)]
pub struct Calls(Arc<Mutex<BTreeMap<&'static str, u32>>>);

impl Calls {
    /// Counts a call.
    pub fn note(&self, method: &'static str) {
        *self.0.lock().unwrap().entry(method).or_default() += 1;
    }

    /// Asserts that every method of the traits was called.
    pub fn assert_complete(&self) {
        let calls = self.0.lock().unwrap();
        let declared = declared();
        assert!(declared.len() > 80, "the traits are not where they were");
        for (trait_of, method) in declared {
            let name = format!("{trait_of}.{method}");
            assert!(calls.contains_key(name.as_str()), "{name} is not exercised");
        }
    }
}

/// Returns the methods of the traits that a database implements.
fn declared() -> Vec<(&'static str, &'static str)> {
    const RECORDS: [&str; 8] = [
        include_str!("../../../../store/src/transaction/accounts.rs"),
        include_str!("../../../../store/src/transaction/alerts.rs"),
        include_str!("../../../../store/src/transaction/answers.rs"),
        include_str!("../../../../store/src/transaction/approvals.rs"),
        include_str!("../../../../store/src/transaction/robots.rs"),
        include_str!("../../../../store/src/transaction/rollouts.rs"),
        include_str!("../../../../store/src/transaction/webhooks.rs"),
        include_str!("../../../../store/src/transaction/mod.rs"),
    ];
    let reader = include_str!("../../../../store/src/backend.rs");
    let of_records = RECORDS.into_iter().flat_map(methods);
    // Of the module itself, `RecordWriter` is what runs the jobs.
    let of_records = of_records.filter(|method| !["run", "close"].contains(method));
    of_records
        .map(|method| ("records", method))
        .chain(methods(reader).map(|method| ("reader", method)))
        .collect()
}

fn methods(source: &'static str) -> impl Iterator<Item = &'static str> {
    let of_line = |line: &'static str| line.trim().strip_prefix("async fn ")?.split('(').next();
    source.lines().filter_map(of_line)
}
