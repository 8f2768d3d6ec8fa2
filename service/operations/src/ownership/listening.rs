//! Subscriptions on Zenoh, and the report of received instances and robots for the other instances.

use std::collections::BTreeSet;

use fleetcal_cluster::{InstanceId, Listening, Seat, Snapshot};

use super::Ownership;

impl Ownership {
    /// Determines which instances and robots it receives, subscribes to the robots of instances
    /// that it does not receive, and reports both in its row.
    pub(super) fn listen(&self, seat: &Seat, snapshot: &Snapshot, listening: &mut Listening) {
        let setup = &self.inner.setup;
        let (now, fleet) = (setup.clock.uptime(), &setup.fleet);
        let hearing = {
            let link = setup.link.borrow();
            listening.look(seat, snapshot, &link, now, |robot| fleet.quiet_for(robot))
        };
        let robots: Vec<_> = listening.robots().cloned().collect();
        fleet.hear(&robots);
        self.inner.hearing.send_if_modified(|known| {
            if hearing.unheard_instances != known.unheard_instances {
                note_unheard(&hearing.unheard_instances);
            }
            let changed = *known != hearing;
            *known = hearing;
            changed
        });
    }
}

fn note_unheard(unheard: &BTreeSet<InstanceId>) {
    let names: Vec<_> = unheard.iter().map(InstanceId::as_str).collect();
    if names.is_empty() {
        tracing::info!("all other instances are received over Zenoh again");
        return;
    }
    let instances = names.join(", ");
    tracing::warn!(
        instances,
        "other instances are not received over Zenoh: robots go to one that receives them"
    );
}
