//! Keys that an agent trusts: those that it was given, and those that took over from them.

use std::time::Duration;

use fleetcal_model::RobotTime;
use fleetcal_proto::calibration::Envelope;
use fleetcal_proto::key_change::KeyChangeDocument;
use fleetcal_proto::signing::{EnvelopeRefused, PublicKey, TRUSTED_KEYS_MAX, TrustedKeys};
use serde::{Deserialize, Serialize};

/// Longest time for which a former key is accepted beside the new one, s.
const FORMER_ACCEPTED_MAX_S: u32 = 366 * 86_400;

/// Keys of an agent that has taken a change of key over. With other `--service-key` values the
/// agent begins again: they are its owner's latest word.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeyRing {
    /// Keys that the agent was given.
    given: Vec<PublicKey>,
    /// Number of the last change; earlier ones are never taken again.
    sequence: u64,
    /// Keys in use, oldest first.
    keys: Vec<AcceptedKey>,
}

/// Key in use.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct AcceptedKey {
    key: PublicKey,
    /// End of its use; absent for a key that was not replaced.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    end: Option<End>,
}

/// End of a former key's use.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct End {
    /// Its time by the robot's clock, ns since 1970.
    at_ns: RobotTime,
    /// Time that it was made from, s.
    lasts_s: u32,
}

impl End {
    fn after(now: RobotTime, lasts_s: u32) -> Self {
        let lasts_s = lasts_s.min(FORMER_ACCEPTED_MAX_S);
        Self {
            at_ns: now.plus(Duration::from_secs(lasts_s.into())),
            lasts_s,
        }
    }
}

impl KeyRing {
    /// Makes the keys of an agent that has taken no change over.
    pub(super) fn of(given: &TrustedKeys) -> Self {
        let given: Vec<PublicKey> = given.keys().copied().collect();
        let keys = given.iter().map(|&key| AcceptedKey { key, end: None });
        Self {
            sequence: 0,
            keys: keys.collect(),
            given,
        }
    }

    /// True if it began with these keys.
    pub(super) fn began_with(&self, given: &TrustedKeys) -> bool {
        given.keys().eq(&self.given)
    }

    /// Returns the keys in use; `None` if there are none.
    pub(super) fn trusted(&self) -> Option<TrustedKeys> {
        TrustedKeys::new(self.keys.iter().map(|accepted| accepted.key).collect()).ok()
    }

    /// Returns the keys after changes, of which the oldest comes first, and those that were new;
    /// none are if the last one leads to a key in use.
    pub(super) fn following(
        &self,
        changes: &[Envelope],
        now: RobotTime,
    ) -> Result<(Self, Vec<KeyChangeDocument>), String> {
        let (mut ring, mut taken) = (self.clone(), Vec::new());
        let lasting = self.lasting()?;
        let is_known = |id: &str| lasting.keys().any(|key| key.id() == id);
        let new = changes
            .iter()
            .skip_while(|change| !is_known(&change.key_id));
        for change in new {
            let document;
            (ring, document) = ring.after(change, now)?;
            taken.push(document);
        }
        let strange = changes.last().filter(|last| !self.is_led_to(last));
        if let (true, Some(strange)) = (taken.is_empty(), strange) {
            // Its refusal names the key that is missing.
            self.after(strange, now)?;
        }
        Ok((ring, taken))
    }

    /// True if a change leads to a key in use. Its signature does not count: nothing follows from it.
    fn is_led_to(&self, change: &Envelope) -> bool {
        let document = serde_json::from_str::<KeyChangeDocument>(&change.document);
        document.is_ok_and(|document| {
            let mut keys = self.keys.iter();
            keys.any(|accepted| accepted.key == document.public_key)
        })
    }

    /// Returns the keys that were not replaced.
    fn lasting(&self) -> Result<TrustedKeys, String> {
        let lasting = self.keys.iter().filter(|accepted| accepted.end.is_none());
        let lasting = TrustedKeys::new(lasting.map(|accepted| accepted.key).collect());
        lasting.map_err(|refused| refused.to_string())
    }

    /// Returns the keys after a change, and the change.
    ///
    /// Only a key that was not replaced may name its successor: one that has leaked since cannot.
    fn after(
        &self,
        change: &Envelope,
        now: RobotTime,
    ) -> Result<(Self, KeyChangeDocument), String> {
        let lasting = self.lasting()?;
        let document: KeyChangeDocument = change
            .open_as(&lasting)
            .map_err(|refused| with_remedy(&refused))?;
        if document.sequence <= self.sequence {
            return Err(format!(
                "sequence: got {}, expected a higher one than {}",
                document.sequence, self.sequence
            ));
        }
        if document.former_key.id() != change.key_id {
            return Err(format!(
                "former_key: got {}, expected the one that signed the change, {}",
                document.former_key.id(),
                change.key_id
            ));
        }
        if document.public_key == document.former_key {
            return Err("public_key: got the former key, expected another one".to_owned());
        }
        let mut next = self.clone();
        next.sequence = document.sequence;
        next.keys
            .retain(|accepted| accepted.key != document.public_key);
        let former = next
            .keys
            .iter_mut()
            .filter(|accepted| accepted.key == document.former_key);
        for accepted in former {
            accepted.end = Some(End::after(now, document.former_accepted_s));
        }
        next.keys.push(AcceptedKey {
            key: document.public_key,
            end: None,
        });
        next.make_room();
        Ok((next, document))
    }

    /// Drops the oldest keys beyond the most that are trusted at once.
    fn make_room(&mut self) {
        let surplus = self.keys.len().saturating_sub(TRUSTED_KEYS_MAX);
        self.keys.drain(..surplus);
    }

    /// Drops the former keys whose time is over.
    pub(super) fn expire(&mut self, now: RobotTime) {
        self.keys
            .retain(|accepted| accepted.end.is_none_or(|end| now < end.at_ns));
    }

    /// Adjusts the ends after a restart: a clock that was set back does not extend them.
    pub(super) fn limit(&mut self, now: RobotTime) {
        for end in self.keys.iter_mut().filter_map(|key| key.end.as_mut()) {
            end.at_ns = end.at_ns.min(End::after(now, end.lasts_s).at_ns);
        }
    }
}

/// Writes a refusal, and the remedy for a robot that was away while the service's key was changed.
pub(super) fn with_remedy(refused: &EnvelopeRefused) -> String {
    match refused {
        EnvelopeRefused::KeyUnknown { .. } => format!(
            "{refused}; if the service's signing key was changed while this robot was away, start \
             its agent with the present one as --service-key"
        ),
        refused => refused.to_string(),
    }
}
