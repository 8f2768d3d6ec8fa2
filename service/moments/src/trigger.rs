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
    /// Begin of the last alert of each robot and kind.
    alerts: BTreeMap<(RobotId, AlertKind), WallTime>,
}

impl Triggers {
    /// Returns the robot, kind and words of the moment that an update asks for at the running time
    /// `now`. What follows a moment within [`limits::MOMENT_AGAIN_AFTER`] asks for none: its data are
    /// in that one.
    pub(crate) fn take(
        &mut self,
        update: &LiveUpdate,
        now: Duration,
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
                let is_there = alert.condition.name() != ConditionName::Normal;
                let began = self
                    .alerts
                    .insert((robot.clone(), alert.kind), alert.began_ns);
                if !is_there || began == Some(alert.began_ns) {
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

    use fleetcal_model::RobotTime;
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
            let taken = triggers.take(&note(kind), Duration::from_secs(second));
            taken.map(|(_, kind, words)| (kind, words))
        };
        let reassembled = Some((MomentKind::Reassembled, "bracket".to_owned()));
        assert_eq!(kinds(NoteKind::Maintenance, 1), None);
        assert_eq!(kinds(NoteKind::Reassembled, 2), reassembled);
        assert_eq!(kinds(NoteKind::Reassembled, 11), None);
        assert_eq!(kinds(NoteKind::Reassembled, 12), reassembled);
    }
}
