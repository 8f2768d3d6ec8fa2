//! Interface of the fleet for instances of a cluster: to begin and end estimating robots, to hear those
//! that are to come, and to mirror those of others.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, PoisonError};
use std::time::Duration;

use fleetcal_cluster::{Duty, Epoch, InstanceId};
use fleetcal_domain::limits::REPORT_WHOLE_EVERY;
use fleetcal_domain::robot::{HistoryEvent, RobotState, RobotView};
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::EstimatedBy;
use tokio::sync::watch;

use super::FleetHandle;
use crate::live::LiveUpdate;
use crate::mailbox::Recipient;
use crate::report::{ReportDetails, Reported, RobotReport, Sender, Told};
use crate::robot::Robot;
use crate::running;
use crate::tenancy::{Keep, Tenancy};

impl FleetHandle {
    /// Begins to keep the messages of robots that this instance is to adopt, for their tasks.
    /// Robots that it estimates or keeps messages of already are unaffected.
    pub fn hear(&self, robots: &[RobotId]) {
        let mut begins = false;
        for id in robots {
            begins |= self.fleet.find_or_add(id).mailbox.hear();
        }
        self.heard_has_changed(begins);
    }

    /// Stops keeping the messages of robots that this instance was to adopt.
    pub fn unhear(&self, robots: &[RobotId]) {
        let mut ends = false;
        for robot in robots.iter().filter_map(|id| self.fleet.find(id.as_str())) {
            ends |= robot.mailbox.unhear();
        }
        self.heard_has_changed(ends);
    }

    /// Returns the robots whose messages are wanted; `None` where one service has all robots.
    pub fn heard(&self) -> Option<BTreeSet<RobotId>> {
        self.fleet.membership.cluster()?;
        let robots = self.fleet.all().into_iter();
        let heard = robots.filter(|robot| robot.mailbox.recipient() != Recipient::Nobody);
        Some(heard.map(|robot| robot.id.clone()).collect())
    }

    /// Returns a channel that signals every change of [`FleetHandle::heard`] from now on.
    pub fn heard_changed(&self) -> watch::Receiver<u64> {
        self.fleet.heard.subscribe()
    }

    /// Sets the robots that the link is subscribed to.
    pub fn set_subscribed(&self, robots: BTreeSet<RobotId>) {
        self.fleet.subscribed.send_replace(robots);
    }

    /// Returns once the link is subscribed to a robot.
    pub async fn subscribed(&self, id: &RobotId) {
        let mut subscribed = self.fleet.subscribed.subscribe();
        // What it gives is a lock, which ends with the statement.
        let stands = subscribed
            .wait_for(|robots| robots.contains(id))
            .await
            .is_ok();
        if !stands {
            // The fleet is gone, and the link with it.
            std::future::pending::<()>().await;
        }
    }

    /// Begins to estimate a robot from the state that the former instance stored. The messages kept
    /// meanwhile follow, except those that the state already covers. A robot that is estimated here
    /// already is unaffected.
    pub fn adopt(&self, id: &RobotId, stored: Option<Vec<u8>>) {
        let robot = self.fleet.find_or_add(id);
        if !robot.mailbox.open() {
            return;
        }
        let tenure = self.fleet.membership.tenure(id);
        robot.begins_here(tenure.map(|tenure| EstimatedBy {
            instance: tenure.seat.instance.as_str().to_owned(),
            epoch: tenure.epoch.0,
        }));
        *tenancy(&robot) = Tenancy::Awaited(stored);
        if robot.is_configured() {
            self.begin_configured(&robot);
        }
        self.heard_has_changed(true);
    }

    /// Ends estimating a robot: on return its task has ended, and another instance may continue.
    /// The robot is mirrored from now on.
    pub async fn release(&self, id: &RobotId, keep: Keep) {
        let Some(robot) = self.fleet.find(id.as_str()) else {
            return;
        };
        if !robot.mailbox.close() {
            self.unhear(std::slice::from_ref(id));
            return;
        }
        if keep == Keep::Nothing {
            robot.mailbox.clear();
        }
        let was = std::mem::take(&mut *tenancy(&robot));
        if let Tenancy::Running(running) = was {
            let wake = || robot.mailbox.wake();
            running.end(&robot.id, keep, wake).await;
        }
        // Of a robot whose configuration never came.
        robot.mailbox.clear();
        robot.ended_here();
        robot.taps.end();
        if keep == Keep::State {
            self.fleet.save_cross_tracks(&robot);
        }
        self.heard_has_changed(true);
    }

    fn heard_has_changed(&self, has_changed: bool) {
        if has_changed {
            self.fleet.heard.send_modify(|changes| *changes += 1);
        }
    }

    /// Begins the task of a robot.
    pub(super) fn spawn(&self, robot: &Arc<Robot>, stored: Option<Vec<u8>>) {
        let running = running::begin(&self.fleet, Arc::clone(robot), stored);
        *tenancy(robot) = Tenancy::Running(running);
    }

    /// Begins the task of a robot whose configuration is known, unless another instance has it.
    pub(super) fn begin_configured(&self, robot: &Arc<Robot>) {
        if self.fleet.membership.cluster().is_none() {
            self.spawn(robot, None);
            return;
        }
        let mut tenancy = tenancy(robot);
        let awaited = match &mut *tenancy {
            Tenancy::Awaited(stored) => stored.take(),
            Tenancy::None | Tenancy::Running(_) => return,
        };
        *tenancy = Tenancy::Running(running::begin(&self.fleet, Arc::clone(robot), awaited));
    }

    /// True if a robot has its vehicle.
    pub fn is_registered(&self, id: &RobotId) -> bool {
        let robot = self.fleet.find(id.as_str());
        robot.is_some_and(|robot| robot.is_configured())
    }

    /// True if another instance estimates the robot, and this one is not to adopt it.
    pub(super) fn is_elsewhere(&self, id: &RobotId) -> bool {
        self.fleet.membership.cluster().is_some()
            && self.fleet.find(id.as_str()).is_some_and(|robot| {
                robot.is_configured() && robot.mailbox.recipient() == Recipient::Nobody
            })
    }

    /// Returns the reports on this instance's robots since the last call; to be called every
    /// [`fleetcal_domain::limits::DIGEST_EVERY`]. Unregistered robots are reported by the instance
    /// that has the duty of discovery.
    pub fn reports(&self, told: &mut Reported) -> Vec<RobotReport> {
        told.live.get_or_insert_with(|| self.live());
        let mut events = told.take_events();
        let discovers = self.fleet.membership.does(Duty::Discovery);
        let is_own = |robot: &Arc<Robot>| {
            if robot.is_configured() {
                robot.is_here()
            } else {
                discovers
            }
        };
        let robots: Vec<_> = self.fleet.all().into_iter().filter(is_own).collect();
        told.robots
            .retain(|id, _| robots.iter().any(|robot| robot.id == *id));
        let reports = robots.iter().filter_map(|robot| {
            let events = events.remove(&robot.id).unwrap_or_default();
            self.report(robot, events, &mut told.robots)
        });
        reports.collect()
    }

    fn report(
        &self,
        robot: &Robot,
        events: Vec<HistoryEvent>,
        told: &mut BTreeMap<RobotId, Told>,
    ) -> Option<RobotReport> {
        let now = self.fleet.clock.elapsed();
        let view = robot.view(&*self.fleet.clock);
        let epoch = match view.config {
            Some(_) => robot.epoch(),
            None => Epoch::default(),
        };
        let connection = &view.connection;
        let latest = (epoch, view.state, connection.stale, connection.last_seen_ns);
        let urgent = robot.urgent();
        let before = told.get(&robot.id);
        let whole_since = before.map(|before| before.whole_at);
        let is_due = whole_since.is_none_or(|then| now.saturating_sub(then) >= REPORT_WHOLE_EVERY);
        let is_whole = is_due || before.is_none_or(|before| before.urgent != urgent);
        let is_same = |before: &Told| match (&before.estimate, &view.estimate) {
            (Some(before), Some(now)) => Arc::ptr_eq(before, now),
            (before, now) => before.is_none() && now.is_none(),
        };
        let told_estimate = before.is_some_and(is_same);
        let changed = before.is_none_or(|before| before.latest != latest) || !told_estimate;
        if !changed && !is_whole && events.is_empty() {
            return None;
        }
        let whole_at = match whole_since {
            // All robots were taken on at once: not all of them are due at once.
            None => now.saturating_sub(spread(&robot.id)),
            Some(then) if !is_whole => then,
            Some(_) => now,
        };
        let now_told = Told {
            whole_at,
            latest,
            estimate: view.estimate.clone(),
            urgent,
        };
        told.insert(robot.id.clone(), now_told);
        let estimate = view.estimate.as_deref();
        let estimate = estimate.filter(|_| is_whole || !told_estimate);
        Some(RobotReport {
            robot: robot.id.clone(),
            epoch,
            state: view.state,
            stale: connection.stale,
            last_seen_ns: connection.last_seen_ns,
            estimate: estimate.cloned().map(Box::new),
            notes_taken: view.notes_taken,
            details: is_whole.then(|| Box::new(details(robot, &view))),
            events,
        })
    }

    /// Stores another instance's reports on its robots and publishes the changes to listeners.
    /// Reports on a robot that is estimated here, or that has a later tenure, are dropped.
    pub fn take_reports(&self, from: &InstanceId, reports: Vec<RobotReport>) {
        let sender = Sender {
            instance: from,
            at: self.fleet.clock.elapsed(),
        };
        for mut report in reports {
            let robot = match self.fleet.find(report.robot.as_str()) {
                None if report.state == RobotState::Unregistered => {
                    self.fleet.find_or_admit(&report.robot)
                }
                known => known,
            };
            let is_of_registered = report.state != RobotState::Unregistered;
            // One that was registered just now is not known everywhere at once.
            let Some(robot) = robot.filter(|robot| robot.is_configured() == is_of_registered)
            else {
                continue;
            };
            let events = std::mem::take(&mut report.events);
            let Ok(estimate) = robot.take_report(sender, report) else {
                continue;
            };
            let id = || robot.id.clone();
            if let Some(document) = estimate {
                let robot = id();
                self.announce(LiveUpdate::Estimate { robot, document });
            }
            for event in events {
                let (robot, event) = (id(), Arc::new(event));
                let author = None;
                self.announce(LiveUpdate::Event {
                    robot,
                    event,
                    author,
                });
            }
        }
    }
}

/// Collects the details of a robot that are reported now and then.
fn details(robot: &Robot, view: &RobotView) -> ReportDetails {
    let verification = view.verification.as_ref();
    let verification =
        verification.map(|(of, estimate)| (*of, Box::new(estimate.as_ref().clone())));
    ReportDetails {
        heard_before_ns: view.connection.heard_before_ns,
        streams: view.connection.streams.clone(),
        counters: view.counters.clone(),
        estimator_restarts: view.estimator_restarts,
        pairing: view.pairing,
        warnings: view.warnings.clone(),
        checks: view.checks.of_causes(),
        verification,
        cross_tracks: robot.cross_tracks().into_iter().collect(),
    }
}

/// Returns a fraction of [`REPORT_WHOLE_EVERY`] that depends on a robot's id.
fn spread(id: &RobotId) -> Duration {
    let sum: u64 = id.as_str().bytes().map(u64::from).sum();
    let whole_ms = u64::try_from(REPORT_WHOLE_EVERY.as_millis()).unwrap_or(u64::MAX);
    Duration::from_millis((sum * 617) % whole_ms)
}

fn tenancy(robot: &Robot) -> std::sync::MutexGuard<'_, Tenancy> {
    robot.tenancy.lock().unwrap_or_else(PoisonError::into_inner)
}
