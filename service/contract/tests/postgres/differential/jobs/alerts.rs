//! Alerts.

use std::fmt::Write as _;

use fleetcal_domain::alert::{Acknowledgement, Alert, AlertKind, Condition, StoredAlert, Subject};
use fleetcal_model::{AlertId, Version, WallTime};
use fleetcal_store::{AlertMoment, StoreError};
use rand::Rng;

use super::super::chance::{number, pick, robot, time, words};
use super::{Run, ask};

impl Run<'_> {
    fn some_alert(&mut self) -> AlertId {
        AlertId(self.chance.random_range(0..6))
    }

    fn moment(&mut self) -> AlertMoment {
        let chance = &mut self.chance;
        AlertMoment {
            at_ns: time(chance),
            version: Version(chance.random_range(0..9)),
            state: Condition::Alerting {
                since_ns: WallTime(1),
            }
            .name()
            .into(),
            what: words(chance),
            by: chance.random_bool(0.5).then(|| words(chance)),
            note: chance.random_bool(0.5).then(|| words(chance)),
        }
    }

    pub(super) async fn add_alert(&mut self) -> Result<(), StoreError> {
        let chance = &mut self.chance;
        let kind = pick(chance, &AlertKind::ALL[..4]);
        let (subject, robots) = match chance.random_range(0..3) {
            0 => (Subject::Fleet, vec![robot(chance), robot(chance)]),
            _ => (Subject::Robot(robot(chance)), Vec::new()),
        };
        let now = time(chance);
        let alert = Alert {
            id: AlertId(0),
            robot: subject.clone(),
            robots,
            kind,
            version: Version(1),
            condition: Condition::Pending { since_ns: now },
            began_ns: now,
            alerted_ns: None,
            ended_ns: None,
            what: words(chance),
            told_ns: WallTime(number(chance)),
            acknowledgement: None,
        };
        if ask!(self, active_alert(&subject, kind)).is_none() {
            ask!(self, add_alert(&alert));
        }
        Ok(())
    }

    pub(super) async fn save_alert(&mut self) -> Result<(), StoreError> {
        let id = self.some_alert();
        let Some(before) = ask!(self, alert(id)).and_then(StoredAlert::known) else {
            return Ok(());
        };
        let since_ns = time(&mut self.chance);
        let chance = &mut self.chance;
        let conditions = [
            Condition::Normal { since_ns },
            Condition::Alerting { since_ns },
            Condition::Recovering { since_ns },
            Condition::NoData { since_ns },
        ];
        let was_active = before.is_active();
        // What is over stays over: another one may be active meanwhile.
        let place = if was_active {
            chance.random_range(0..4)
        } else {
            0
        };
        let after = Alert {
            condition: conditions[place],
            version: before.version.next(),
            ended_ns: (place == 0).then_some(since_ns),
            what: words(chance),
            acknowledgement: chance.random_bool(0.5).then(|| Acknowledgement {
                by: words(chance),
                at_ns: since_ns,
                note: None,
            }),
            ..before
        };
        ask!(self, save_alert(&after));
        let (moment, kept) = (self.moment(), self.chance.random_range(1..4));
        ask!(self, add_alert_moment(id, &moment, kept));
        Ok(())
    }

    pub(super) async fn delete_alert(&mut self) -> Result<(), StoreError> {
        let id = self.some_alert();
        ask!(self, delete_alert(id));
        ask!(self, alert(id));
        Ok(())
    }
}
