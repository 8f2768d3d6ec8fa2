//! A robot that another instance estimates, as that instance reports it.

use std::sync::Arc;

use fleetcal_clock::Clock;
use fleetcal_cluster::Epoch;
use fleetcal_domain::limits::REPORTS_STALE_AFTER;
use fleetcal_domain::robot::{Connection, Counters, RobotState};
use fleetcal_proto::estimate::{EstimateDocument, EstimatedBy};

use super::estimators::{Mirror, Replaced};
use super::{Robot, lock};
use crate::mailbox::Recipient;
use crate::report::{ReportDetails, RobotReport, Sender, Urgent};
use crate::tenancy::Tenancy;

impl Robot {
    /// True if its task is here, or is to be.
    pub fn is_here(&self) -> bool {
        self.mailbox.recipient() == Recipient::Task
    }

    /// True if its messages are kept although its configuration is not known yet.
    pub fn is_awaited(&self) -> bool {
        let is_awaited = matches!(*lock(&self.tenancy), Tenancy::Awaited(_));
        is_awaited || self.mailbox.recipient() == Recipient::Heir
    }

    /// Records that this instance has begun to estimate it.
    pub fn begins_here(&self, by: Option<EstimatedBy>) {
        let mut estimators = lock(&self.estimators);
        if let Some(by) = &by {
            estimators.epoch = estimators.epoch.max(Epoch(by.epoch));
        }
        estimators.by = by;
        let mirror = estimators.mirror.take();
        drop(estimators);
        // What the instance before had taken may not be in the state that it has stored.
        lock(&self.status).notes_taken = None;
        if let Some(mirror) = mirror {
            let mut link = lock(&self.link);
            let before = mirror.last_seen_ns.max(mirror.heard_before_ns);
            link.heard_before_ns = link.heard_before_ns.max(before);
        }
    }

    /// Records that this instance no longer estimates it.
    pub fn ended_here(&self) {
        lock(&self.estimators).by = None;
        let mut link = lock(&self.link);
        link.session = super::Session::Ended;
    }

    /// Returns the epoch of its tenure here.
    pub fn epoch(&self) -> Epoch {
        lock(&self.estimators).epoch
    }

    /// Returns the instance that estimates it.
    pub fn estimated_by(&self) -> Option<EstimatedBy> {
        lock(&self.estimators).by.clone()
    }

    /// Resets the view: nothing is known, and its task begins from nothing.
    pub fn show_nothing(&self) {
        let mut status = lock(&self.status);
        status.verification = None;
        status.state = RobotState::NoData;
        status.estimate = None;
        status.candidate = super::Candidate::default();
    }

    /// Stores the report of the instance that estimates it; returns the estimate, if that is a new
    /// one.
    ///
    /// # Errors
    /// The report comes from an instance that was replaced.
    pub fn take_report(
        &self,
        sender: Sender<'_>,
        report: RobotReport,
    ) -> Result<Option<Arc<EstimateDocument>>, Replaced> {
        let is_whole = report.details.is_some();
        {
            let mut estimators = lock(&self.estimators);
            if self.is_here() || report.epoch < estimators.epoch {
                return Err(Replaced);
            }
            estimators.epoch = report.epoch;
            estimators.by = (report.state != RobotState::Unregistered).then(|| EstimatedBy {
                instance: sender.instance.as_str().to_owned(),
                epoch: report.epoch.0,
            });
            let before = estimators.mirror.take();
            estimators.mirror = Some(Mirror::of(sender.at, &report, before));
        }
        if let Some(details) = report.details.as_deref() {
            self.take_cross_tracks(details);
        }
        let mut status = lock(&self.status);
        status.state = report.state;
        status.notes_taken = report.notes_taken.or(status.notes_taken);
        let estimate = report.estimate.map(|estimate| Arc::new(*estimate));
        if let Some(estimate) = &estimate {
            status.reassembly_open = estimate.reassembly_open;
        }
        if estimate.is_some() || is_whole {
            status.estimate.clone_from(&estimate);
        }
        if let Some(details) = report.details {
            status.estimator_restarts = details.estimator_restarts;
            status.pairing = details.pairing;
            status.warnings = details.warnings;
            status.checks = Arc::new(details.checks);
            let verification = details.verification;
            status.verification = verification.map(|(of, estimate)| (of, Arc::new(*estimate)));
        }
        Ok(estimate)
    }

    fn take_cross_tracks(&self, details: &ReportDetails) {
        let stored = details.cross_tracks.iter().cloned().collect();
        *lock(&self.cross_tracks) = super::CrossTracks::of(stored);
    }

    /// True if the mirrored report is stale; `None` for a robot that is not mirrored.
    pub(super) fn is_mirror_stale(&self, clock: &dyn Clock) -> Option<bool> {
        if self.is_here() {
            return None;
        }
        let estimators = lock(&self.estimators);
        let mirror = estimators.mirror.as_ref()?;
        let age = clock.elapsed().saturating_sub(mirror.at);
        Some(mirror.stale || age >= REPORTS_STALE_AFTER)
    }

    /// Returns the connection and counters to be shown: those reported by the robot's instance, or
    /// the own ones in the absence of a report.
    pub(super) fn mirrored(&self, own: Connection, counters: Counters) -> (Connection, Counters) {
        if self.is_here() {
            return (own, counters);
        }
        match &lock(&self.estimators).mirror {
            None => (own, counters),
            Some(mirror) => {
                let connection = Connection {
                    last_seen_ns: mirror.last_seen_ns,
                    heard_before_ns: mirror.heard_before_ns,
                    streams: mirror.streams.clone(),
                    ..own
                };
                (connection, mirror.counters.clone())
            }
        }
    }

    /// Returns the details that are reported at once when they change.
    pub(crate) fn urgent(&self) -> Urgent {
        let status = lock(&self.status);
        Urgent {
            warnings: status.warnings.clone(),
            verification: status.verification.clone(),
            restarts: status.estimator_restarts,
        }
    }
}
