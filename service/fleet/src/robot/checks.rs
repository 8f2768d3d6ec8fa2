//! Joining checks of a robot, and the warnings about its messages.

use std::sync::Arc;

use fleetcal_clock::Clock;
use fleetcal_domain::limits::FORMER_KEY_WARNED_FOR;
use fleetcal_domain::robot::{ChecksReport, Warning};

use super::{Robot, lock};

impl Robot {
    /// Returns the report of its joining checks.
    pub fn checks(&self) -> Arc<ChecksReport> {
        Arc::clone(&lock(&self.status).checks)
    }

    /// Sets the report of its joining checks; returns whether other causes are named.
    pub fn set_checks(&self, report: ChecksReport) -> bool {
        let report = Arc::new(report);
        let before = std::mem::replace(&mut lock(&self.status).checks, Arc::clone(&report));
        let causes = |report: &ChecksReport| -> Vec<Option<String>> {
            report.named().map(|one| one.cause.clone()).collect()
        };
        causes(&before) != causes(&report)
    }

    /// Sets the warnings; returns whether there are others than before.
    pub fn set_warnings(&self, warnings: Vec<Warning>) -> bool {
        let kinds = |warnings: &[Warning]| -> Vec<_> {
            warnings.iter().map(|warning| warning.kind).collect()
        };
        let mut status = lock(&self.status);
        let changed = kinds(&status.warnings) != kinds(&warnings);
        status.warnings = warnings;
        changed
    }

    pub(super) fn warning_of_former_key(&self, clock: &dyn Clock) -> Option<Warning> {
        let link = lock(&self.link);
        let (at, key) = link.former_key.as_ref()?;
        let since = clock.elapsed().saturating_sub(*at);
        (since < FORMER_KEY_WARNED_FOR).then(|| Warning::former_key(key))
    }
}
