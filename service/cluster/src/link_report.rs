//! Report of an instance's link to Zenoh about itself and the other instances.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use fleetcal_domain::limits::{CLUSTER_LEASE, CLUSTER_LOOK_EVERY};

use crate::InstanceId;

/// Interval of an instance's heartbeats over Zenoh.
pub const HEARTBEAT_EVERY: Duration = Duration::from_millis(100);
/// Time without heartbeats after which an instance is silent: two may be late or lost.
pub const HEARTBEATS_MISSING_AFTER: Duration = Duration::from_millis(300);
/// Time without heartbeats after which an instance that still has a token is a program that sends
/// none.
const TOKEN_OUTLIVES_CUT_MAX: Duration = Duration::from_secs(30);
/// Largest distance of two looks at the heartbeats that may be compared: with a longer one the
/// process was held up, and heartbeats of that time are still unread.
const LOOKS_APART_MAX: Duration = CLUSTER_LOOK_EVERY.saturating_mul(2);

/// Report of an instance's link to Zenoh.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct LinkReport {
    /// True if robots reach this instance.
    pub linked: bool,
    /// Instances whose liveliness tokens are present.
    pub present: BTreeSet<InstanceId>,
    /// Receipt of the latest heartbeat of each, running time; an older program sends none.
    heartbeats: BTreeMap<InstanceId, Duration>,
}

impl LinkReport {
    /// Records that the token of an instance is present or gone; returns true if this is new.
    pub fn note_token(&mut self, instance: InstanceId, stands: bool) -> bool {
        if stands {
            return self.present.insert(instance);
        }
        self.heartbeats.remove(&instance);
        self.present.remove(&instance)
    }

    /// Records a heartbeat received at `now`, running time. Without a token it is ignored.
    pub fn note_heartbeat(&mut self, instance: InstanceId, now: Duration) {
        if self.present.contains(&instance) {
            self.heartbeats.insert(instance, now);
        }
    }

    /// True if an instance is received at `now`, running time: its token is present, and its
    /// heartbeats arrive if one ever has. A token outlives a disconnection of the routers by
    /// Zenoh's `lease`, ten seconds unless configured.
    pub fn hears(&self, instance: &InstanceId, now: Duration) -> bool {
        let missing_for = |at: &Duration| now.saturating_sub(*at);
        let latest = self.heartbeats.get(instance).map(missing_for);
        let is_missing = latest.is_some_and(|missing| {
            (HEARTBEATS_MISSING_AFTER..TOKEN_OUTLIVES_CUT_MAX).contains(&missing)
        });
        self.present.contains(instance) && !is_missing
    }

    /// True if the heartbeats of an instance are missing at `now`, running time, while its token is
    /// present: with a transport that closes nothing for a killed process, such as QUIC, the token
    /// outlives the process by Zenoh's `lease`. After a lease of the cluster the database has
    /// decided: an instance that still has a token is then a program that sends no heartbeats.
    pub fn is_silent(&self, instance: &InstanceId, now: Duration) -> bool {
        let missing_for = |at: &Duration| now.saturating_sub(*at);
        let latest = self.heartbeats.get(instance).map(missing_for);
        latest.is_some_and(|missing| (HEARTBEATS_MISSING_AFTER..CLUSTER_LEASE).contains(&missing))
    }
}

/// Instances that were silent at the last look.
#[derive(Debug, Default)]
pub struct Silence {
    looked_at: Duration,
    silent: BTreeSet<InstanceId>,
}

impl Silence {
    /// Stores the instances that are silent at `now`, running time; returns those of them that were
    /// silent shortly before as well.
    pub fn lasting(&mut self, silent: BTreeSet<InstanceId>, now: Duration) -> BTreeSet<InstanceId> {
        let was_held_up = now.saturating_sub(self.looked_at) > LOOKS_APART_MAX;
        let before = std::mem::replace(&mut self.silent, silent);
        self.looked_at = now;
        if was_held_up {
            return BTreeSet::new();
        }
        self.silent.intersection(&before).cloned().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEARD_AT: Duration = Duration::from_secs(7);

    fn b() -> InstanceId {
        InstanceId::parse("b").unwrap()
    }

    /// Report with a token and a heartbeat.
    fn heard() -> LinkReport {
        let mut report = LinkReport::default();
        assert!(report.note_token(b(), true));
        report.note_heartbeat(b(), HEARD_AT);
        report
    }

    #[test]
    fn an_instance_is_silent_once_its_heartbeats_are_missing() {
        let mut report = heard();
        let missing_at = HEARD_AT + HEARTBEATS_MISSING_AFTER;
        assert!(!report.is_silent(&b(), missing_at.saturating_sub(Duration::from_nanos(1))));
        assert!(report.is_silent(&b(), missing_at));
        report.note_heartbeat(b(), missing_at);
        assert!(!report.is_silent(&b(), missing_at));
    }

    #[test]
    fn an_instance_that_sends_no_heartbeats_is_judged_by_its_token() {
        let mut report = LinkReport::default();
        report.note_heartbeat(b(), HEARD_AT);
        assert_eq!(report, LinkReport::default(), "no token: not noted");
        report.note_token(b(), true);
        assert!(!report.is_silent(&b(), HEARD_AT + HEARTBEATS_MISSING_AFTER));
        // It was replaced by a former program under the same token.
        assert!(!heard().is_silent(&b(), HEARD_AT + CLUSTER_LEASE));
    }

    #[test]
    fn an_instance_is_heard_by_token_and_heartbeats() {
        let late = HEARD_AT + HEARTBEATS_MISSING_AFTER;
        let heard = heard();
        assert!(heard.hears(&b(), HEARD_AT));
        assert!(!heard.hears(&b(), late));
        assert!(!heard.hears(&b(), HEARD_AT + CLUSTER_LEASE));
        let mut former = LinkReport::default();
        assert!(!former.hears(&b(), HEARD_AT));
        former.note_token(b(), true);
        assert!(former.hears(&b(), late), "it sends no heartbeats");
    }

    #[test]
    fn heartbeats_of_a_former_life_do_not_count() {
        let mut report = heard();
        assert!(report.note_token(b(), false));
        report.note_token(b(), true);
        assert!(!report.is_silent(&b(), HEARD_AT + HEARTBEATS_MISSING_AFTER));
    }

    #[test]
    fn silence_lasts_over_two_looks_of_one_that_was_not_held_up() {
        let mut silence = Silence::default();
        let silent = || BTreeSet::from([b()]);
        let mut now = HEARD_AT;
        let mut look_after = |pause, silent| {
            now += pause;
            silence.lasting(silent, now)
        };
        let held_up = LOOKS_APART_MAX + Duration::from_nanos(1);
        assert_eq!(look_after(CLUSTER_LOOK_EVERY, silent()), BTreeSet::new());
        assert_eq!(
            look_after(held_up, silent()),
            BTreeSet::new(),
            "it was held up"
        );
        assert_eq!(look_after(CLUSTER_LOOK_EVERY, silent()), silent());
        assert_eq!(
            look_after(CLUSTER_LOOK_EVERY, BTreeSet::new()),
            BTreeSet::new()
        );
        assert_eq!(look_after(CLUSTER_LOOK_EVERY, silent()), BTreeSet::new());
    }
}
