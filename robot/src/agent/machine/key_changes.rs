//! Changes of the service's signing key, as the agent takes them over.

use fleetcal_model::RobotTime;
use fleetcal_proto::calibration::Envelope;
use fleetcal_proto::key_change::KeyChangeDocument;
use fleetcal_proto::signing::TrustedKeys;

use super::Agent;
use crate::agent::event::{Effect, Event};
use crate::agent::keys::KeyRing;

impl Agent {
    /// Returns the keys that it trusts now.
    pub fn trusted(&self) -> &TrustedKeys {
        &self.identity.trusted
    }

    /// Goes on with the keys of its memory, unless it was given others since.
    pub(super) fn begin_with_keys(&mut self) {
        let given = &self.given;
        self.memory.keys.take_if(|ring| !ring.began_with(given));
        self.trust();
    }

    fn trust(&mut self) {
        let ring = self.memory.keys.as_ref();
        let trusted = ring.and_then(KeyRing::trusted);
        self.identity.trusted = trusted.unwrap_or_else(|| self.given.clone());
    }

    /// Ends the use of former keys whose time is over.
    pub(super) fn expire_keys(&mut self, event: &Event, now: RobotTime) {
        let Some(ring) = &mut self.memory.keys else {
            return;
        };
        if matches!(event, Event::Restarted { .. }) {
            ring.limit(now);
        }
        ring.expire(now);
        self.trust();
    }

    /// Takes changes of key over, the first of which a key that it trusts has signed.
    pub(super) fn key_changed(&mut self, changes: &[Envelope], now: RobotTime) -> Vec<Effect> {
        let ring = self.memory.keys.clone();
        let ring = ring.unwrap_or_else(|| KeyRing::of(&self.given));
        match ring.following(changes, now) {
            Ok((_, taken)) if taken.is_empty() => Vec::new(),
            Ok((ring, taken)) => {
                self.memory.keys = Some(ring);
                self.trust();
                let note = |document: &KeyChangeDocument| {
                    Effect::Note(format!(
                        "the service's signing key has changed: {} is trusted from now on, {} for \
                         {} s more",
                        document.public_key.id(),
                        document.former_key.id(),
                        document.former_accepted_s
                    ))
                };
                taken.iter().map(note).collect()
            }
            Err(reason) => self.disbelieve("a change of key", &reason, now),
        }
    }
}
