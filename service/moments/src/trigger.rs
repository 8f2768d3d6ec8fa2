//! Events after which a robot's latest data are kept.

use std::collections::BTreeMap;
use std::time::Duration;

use fleetcal_domain::alert::{AlertKind, ConditionName};
use fleetcal_domain::limits;
use fleetcal_domain::robot::{HistoryEvent, ServiceEventKind};
use fleetcal_fleet::live::LiveUpdate;
use fleetcal_fleet::words;
use fleetcal_model::{ChangeKind, NoteKind, RobotId, WallTime};

use crate::MomentKind;

/// Memory of what has triggered moments; at most an entry for each robot, and for each of its kinds
/// of alerts.
#[derive(Debug, Default)]
pub(crate) struct Triggers {
    /// Running time of each robot's last moment.
    last: BTreeMap<RobotId, Duration>,
    /// Time at which the last alert of each robot and kind first alerted.
    alerts: BTreeMap<(RobotId, AlertKind), WallTime>,
}

impl Triggers {
    /// Returns the robot, kind and words of the moment that an update asks for at the running time
    /// `now` and the time `at`. An alert asks for one when it alerts, while the data before it are
    /// held: not while it is pending, and not when an older one changes. What follows a moment
    /// within [`limits::MOMENT_AGAIN_AFTER`] asks for none: its data are in that one.
    pub(crate) fn take(
        &mut self,
        update: &LiveUpdate,
        now: Duration,
        at: WallTime,
    ) -> Option<(RobotId, MomentKind, String)> {
        let (robot, kind, words) = match update {
            LiveUpdate::Event { robot, event, .. } => {
                let (kind, words) = of_event(event)?;
                (robot, kind, words)
            }
            LiveUpdate::Alert {
                robot: Some(robot),
                alert,
            } => {
                let kind = of_alert(alert.kind)?;
                let alerted = alert.alerted_ns.filter(|alerted| {
                    alert.condition.name() == ConditionName::Alerting
                        && *alerted >= at.minus(limits::MOMENT_SPAN)
                })?;
                let before = self.alerts.insert((robot.clone(), alert.kind), alerted);
                if before == Some(alerted) {
                    return None;
                }
                (robot, kind, alert.what.clone())
            }
            _ => return None,
        };
        let last = self.last.get(robot);
        if last.is_some_and(|last| now.saturating_sub(*last) < limits::MOMENT_AGAIN_AFTER) {
            return None;
        }
        self.last.insert(robot.clone(), now);
        Some((robot.clone(), kind, words))
    }
}

fn of_event(event: &HistoryEvent) -> Option<(MomentKind, String)> {
    match event {
        HistoryEvent::Change(change) => {
            let kind = match change.kind {
                ChangeKind::Fault => MomentKind::Fault,
                ChangeKind::CalibrationChanged => MomentKind::Change,
                ChangeKind::CalibrationConfirmed | ChangeKind::CalibrationLearned => return None,
            };
            Some((kind, words::event(change)))
        }
        HistoryEvent::Note(note) if note.kind == NoteKind::Reassembled => {
            Some((MomentKind::Reassembled, note.note.clone()))
        }
        HistoryEvent::Service(event) => match event.kind {
            ServiceEventKind::EstimatorRestarted | ServiceEventKind::EstimatorStopped => {
                Some((MomentKind::Fault, event.note.clone()))
            }
            ServiceEventKind::SessionStarted | ServiceEventKind::Configured => None,
        },
        HistoryEvent::Note(_) => None,
    }
}

fn of_alert(kind: AlertKind) -> Option<MomentKind> {
    match kind {
        AlertKind::VerificationFailed => Some(MomentKind::VerificationFailed),
        AlertKind::Fault | AlertKind::TwoSenders | AlertKind::NoData => Some(MomentKind::Fault),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use fleetcal_domain::alert::{Alert, Condition, Subject};
    use fleetcal_model::{AlertId, RobotTime, Version};
    use fleetcal_proto::event::RobotEvent;

    use super::*;

    #[test]
    fn a_reassembly_asks_for_one_moment_however_often_it_is_reported() {
        let note = |kind| LiveUpdate::Event {
            robot: RobotId::parse("a").unwrap(),
            event: Arc::new(HistoryEvent::Note(RobotEvent {
                kind,
                stamp_ns: RobotTime(1),
                note: "bracket".to_owned(),
            })),
            author: None,
        };
        let mut triggers = Triggers::default();
        let mut kinds = |kind, second| {
            let taken = triggers.take(&note(kind), Duration::from_secs(second), WallTime(0));
            taken.map(|(_, kind, words)| (kind, words))
        };
        let reassembled = Some((MomentKind::Reassembled, "bracket".to_owned()));
        assert_eq!(kinds(NoteKind::Maintenance, 1), None);
        assert_eq!(kinds(NoteKind::Reassembled, 2), reassembled);
        assert_eq!(kinds(NoteKind::Reassembled, 11), None);
        assert_eq!(kinds(NoteKind::Reassembled, 12), reassembled);
    }

    const S: i64 = 1_000_000_000;

    /// Update about an alert that began at 100 s, in this condition.
    fn alert(condition: Condition, alerted_s: Option<i64>) -> LiveUpdate {
        let robot = RobotId::parse("a").unwrap();
        LiveUpdate::Alert {
            robot: Some(robot.clone()),
            alert: Arc::new(Alert {
                id: AlertId(1),
                robot: Subject::Robot(robot),
                robots: Vec::new(),
                kind: AlertKind::NoData,
                version: Version(1),
                condition,
                began_ns: WallTime(100 * S),
                alerted_ns: alerted_s.map(|second| WallTime(second * S)),
                ended_ns: None,
                what: "silent".to_owned(),
                told_ns: WallTime(100 * S),
                acknowledgement: None,
            }),
        }
    }

    fn kind(triggers: &mut Triggers, update: &LiveUpdate, second: i64) -> Option<MomentKind> {
        let now = Duration::from_secs(second as u64);
        let taken = triggers.take(update, now, WallTime(second * S));
        taken.map(|(_, kind, _)| kind)
    }

    #[test]
    fn an_alert_asks_for_a_moment_when_it_alerts_and_not_while_it_is_pending() {
        let since_ns = WallTime(100 * S);
        let mut triggers = Triggers::default();
        let pending = alert(Condition::Pending { since_ns }, None);
        assert_eq!(kind(&mut triggers, &pending, 100), None);
        let gone = alert(Condition::Normal { since_ns }, None);
        assert_eq!(kind(&mut triggers, &gone, 103), None);
        let alerting = alert(Condition::Alerting { since_ns }, Some(110));
        let fault = Some(MomentKind::Fault);
        assert_eq!(kind(&mut triggers, &alerting, 110), fault);
        // Acknowledged, on its way to normal, and back.
        assert_eq!(kind(&mut triggers, &alerting, 130), None);
        let recovering = alert(Condition::Recovering { since_ns }, Some(110));
        assert_eq!(kind(&mut triggers, &recovering, 140), None);
        assert_eq!(kind(&mut triggers, &alerting, 150), None);
        let another = alert(Condition::Alerting { since_ns }, Some(400));
        assert_eq!(kind(&mut triggers, &another, 400), fault);
    }

    #[test]
    fn an_old_alert_asks_for_no_moment_after_a_restart() {
        let since_ns = WallTime(110 * S);
        let span_s = limits::MOMENT_SPAN.as_secs() as i64;
        let alerting = alert(Condition::Alerting { since_ns }, Some(110));
        let after_restart = |second| kind(&mut Triggers::default(), &alerting, second);
        assert_eq!(after_restart(110 + span_s), Some(MomentKind::Fault));
        assert_eq!(after_restart(110 + span_s + 1), None);
    }
}
