//! Change of the service's signing key, signed with the key that it ends.
//!
//! Whoever trusts the former key takes the new one over by it. Changes are numbered, and each is
//! signed with the key that the one before brought: neither an old change nor a key that has ended
//! leads anywhere. A change travels as an [`Envelope`].

use std::collections::BTreeSet;

use fleetcal_model::WallTime;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::calibration::Envelope;
use crate::signing::{
    EnvelopeRefused, PublicKey, SealRefused, SigningKey, Statement, TrustedKeys, read_text, sign,
};

/// Most changes that are kept: those before them are dropped first.
pub const KEY_CHANGES_MAX: usize = 64;
/// Most bytes of a signed change as JSON, on the wire and in a file: one has about 700.
pub const KEY_CHANGE_BYTES_MAX: usize = 2048;

/// Schema of a change of key.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum KeyChangeSchema {
    /// The first version.
    #[default]
    #[serde(rename = "fleetcal.key_change/1")]
    V1,
}

/// Change of the service's signing key.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeyChangeDocument {
    /// Schema of the document.
    pub schema: KeyChangeSchema,
    /// Number of the change: 1 for a service's first one.
    pub sequence: u64,
    /// Key that ends, and signs this.
    pub former_key: PublicKey,
    /// Key that follows it.
    pub public_key: PublicKey,
    /// Time of the change by the service's clock, ns since 1970.
    pub changed_at_ns: WallTime,
    /// Time for which a robot accepts the former key beside the new one, s: by its clock, from the
    /// moment at which it takes the new key over.
    pub former_accepted_s: u32,
}

impl Statement for KeyChangeDocument {
    const SCHEMA: &'static str = "fleetcal.key_change/1";
}

/// Announcement of the changes, beside the answer to a robot's query for its calibration. It has no
/// end: a robot that was away follows them when it comes back.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeyAnnouncement {
    /// The signed changes, oldest first.
    pub key_changes: Vec<Envelope>,
}

/// Reason for which changes of key do not lead from one key to the next.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum KeyChangesRefused {
    /// There are too many.
    #[error("got {0} changes, expected {KEY_CHANGES_MAX} at most")]
    TooMany(usize),
    /// One is not genuine.
    #[error("change {number}: {refused}")]
    Change {
        /// Its place, from 1 on.
        number: usize,
        /// The check that failed.
        refused: EnvelopeRefused,
    },
    /// One does not follow the one before.
    #[error("change {number}: got {found}, expected {expected}")]
    Order {
        /// Its place, from 1 on.
        number: usize,
        /// Key that it ends, with its sequence number.
        found: String,
        /// Key and sequence number that follow from the change before.
        expected: String,
    },
}

/// Changes of a service's key, oldest first: each ends the key that the one before brought.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct KeyChanges(Vec<(KeyChangeDocument, Envelope)>);

impl KeyChanges {
    /// Checks that each change is signed with the key that it ends, and follows the one before.
    ///
    /// # Errors
    /// [`KeyChangesRefused`], with the place of the first fault.
    pub fn check(envelopes: Vec<Envelope>) -> Result<Self, KeyChangesRefused> {
        if envelopes.len() > KEY_CHANGES_MAX {
            return Err(KeyChangesRefused::TooMany(envelopes.len()));
        }
        let mut changes: Vec<(KeyChangeDocument, Envelope)> = Vec::new();
        for (index, envelope) in envelopes.into_iter().enumerate() {
            let number = index + 1;
            let document = self_signed(&envelope)
                .map_err(|refused| KeyChangesRefused::Change { number, refused })?;
            if let Some((before, _)) = changes.last() {
                let expected = (before.sequence.saturating_add(1), before.public_key);
                let found = (document.sequence, document.former_key);
                if found != expected {
                    let text = |(sequence, key): (u64, PublicKey)| {
                        format!("number {sequence}, which ends {}", key.id())
                    };
                    return Err(KeyChangesRefused::Order {
                        number,
                        found: text(found),
                        expected: text(expected),
                    });
                }
            }
            changes.push((document, envelope));
        }
        Ok(Self(changes))
    }

    /// Drops what follows the change that brought `key`: it was not finished. None remains when no
    /// change brought it, or ended it.
    #[must_use]
    pub fn up_to(mut self, key: &PublicKey) -> Self {
        let brought = self.0.iter().rposition(|(one, _)| one.public_key == *key);
        self.0.truncate(brought.map_or(0, |index| index + 1));
        self
    }

    /// Adds the change from `former` to `new`.
    ///
    /// # Errors
    /// As [`sign`].
    pub fn add(
        &mut self,
        former: &SigningKey,
        new: &PublicKey,
        changed_at_ns: WallTime,
        former_accepted_s: u32,
    ) -> Result<(), SealRefused> {
        let last = self.0.last().map_or(0, |(last, _)| last.sequence);
        let document = KeyChangeDocument {
            schema: KeyChangeSchema::V1,
            sequence: last.saturating_add(1),
            former_key: former.public_key(),
            public_key: *new,
            changed_at_ns,
            former_accepted_s,
        };
        let envelope = sign(&document, former)?;
        self.0.push((document, envelope));
        let surplus = self.0.len().saturating_sub(KEY_CHANGES_MAX);
        self.0.drain(..surplus);
        Ok(())
    }

    /// Returns the announcement of the changes; `None` if there are none.
    pub fn announcement(&self) -> Option<KeyAnnouncement> {
        let key_changes = self.envelopes();
        (!key_changes.is_empty()).then_some(KeyAnnouncement { key_changes })
    }

    /// Returns the signed changes, oldest first.
    pub fn envelopes(&self) -> Vec<Envelope> {
        self.0
            .iter()
            .map(|(_, envelope)| envelope.clone())
            .collect()
    }

    /// Returns the keys that ended, oldest first.
    pub fn former_keys(&self) -> Vec<PublicKey> {
        self.0.iter().map(|(change, _)| change.former_key).collect()
    }

    /// Returns the keys to which these changes lead from `trusted` ones, besides those. A key before
    /// a trusted one is not trusted: it may have ended because others know it.
    pub fn followed_from(&self, trusted: &TrustedKeys) -> TrustedKeys {
        let mut known: BTreeSet<String> = trusted.keys().map(PublicKey::id).collect();
        let mut followed = trusted.clone();
        for (change, _) in &self.0 {
            if known.contains(&change.former_key.id()) && known.insert(change.public_key.id()) {
                followed = followed.and(change.public_key);
            }
        }
        followed
    }
}

/// Key that a service signs with, and the changes that led to it.
#[derive(Debug, Clone)]
pub struct ServiceKeys {
    /// The key.
    pub key: SigningKey,
    /// The changes, the last of which brought the key.
    pub changes: KeyChanges,
}

impl From<SigningKey> for ServiceKeys {
    fn from(key: SigningKey) -> Self {
        Self {
            key,
            changes: KeyChanges::default(),
        }
    }
}

impl ServiceKeys {
    /// Returns a document signed with the present key: robots that took it over refuse former ones.
    /// A document of neither stays as it is.
    pub fn renewed(&self, envelope: Envelope) -> Envelope {
        let is_former = |key: &PublicKey| key.id() == envelope.key_id;
        let former = self.changes.former_keys().into_iter().find(is_former);
        let is_genuine = |key: PublicKey| envelope.open(&key.into()).is_ok();
        if former.is_some_and(is_genuine) {
            envelope.signed_again(&self.key)
        } else {
            envelope
        }
    }
}

/// Opens a change by the key that it says it ends.
fn self_signed(envelope: &Envelope) -> Result<KeyChangeDocument, EnvelopeRefused> {
    let claimed: KeyChangeDocument = read_text(&envelope.document)?;
    envelope.open_as(&claimed.former_key.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(number: u8) -> SigningKey {
        SigningKey::from_bytes(&[number; 32])
    }

    /// Makes changes from key 1 to key 2 and so on.
    fn chain(keys: u8) -> KeyChanges {
        let mut changes = KeyChanges::default();
        for number in 1..keys {
            let new = key(number + 1).public_key();
            let at = WallTime(i64::from(number) * 1_000_000_000);
            changes.add(&key(number), &new, at, 60).unwrap();
        }
        changes
    }

    #[test]
    fn a_chain_leads_forward_and_never_back() {
        let changes = chain(4);
        assert_eq!(KeyChanges::check(changes.envelopes()).unwrap(), changes);
        let from = |number: u8| changes.followed_from(&key(number).public_key().into());
        assert_eq!(from(1).keys().count(), 4);
        assert_eq!(from(3).keys().count(), 2);
        assert_eq!(from(4).keys().count(), 1);
        assert_eq!(from(9).keys().count(), 1, "a stranger leads nowhere");
    }

    #[test]
    fn a_change_that_does_not_follow_is_refused() {
        let refused = |envelopes: Vec<Envelope>| KeyChanges::check(envelopes).unwrap_err();
        let envelopes = chain(4).envelopes();
        let swapped = vec![envelopes[1].clone(), envelopes[0].clone()];
        assert!(matches!(
            refused(swapped),
            KeyChangesRefused::Order { number: 2, .. }
        ));
        let gap = vec![envelopes[0].clone(), envelopes[2].clone()];
        assert!(matches!(
            refused(gap),
            KeyChangesRefused::Order { number: 2, .. }
        ));
        let mut altered = envelopes.clone();
        altered[1].document = altered[1]
            .document
            .replace("\"former_accepted_s\":60", "\"former_accepted_s\":61");
        assert!(matches!(
            refused(altered),
            KeyChangesRefused::Change { number: 2, .. }
        ));
        // The document of one key, signed with another.
        let stolen = KeyChangeDocument {
            schema: KeyChangeSchema::V1,
            sequence: 1,
            former_key: key(1).public_key(),
            public_key: key(9).public_key(),
            changed_at_ns: WallTime(0),
            former_accepted_s: 60,
        };
        let stolen = sign(&stolen, &key(9)).unwrap();
        assert!(matches!(
            refused(vec![stolen]),
            KeyChangesRefused::Change { number: 1, .. }
        ));
        let many = vec![envelopes[0].clone(); KEY_CHANGES_MAX + 1];
        assert!(matches!(refused(many), KeyChangesRefused::TooMany(_)));
    }

    #[test]
    fn an_unfinished_change_is_dropped_and_old_ones_make_room() {
        let changes = chain(4);
        let of = |number: u8| changes.clone().up_to(&key(number).public_key());
        assert_eq!(of(4), changes);
        assert_eq!(of(3), chain(3));
        assert_eq!(of(1), KeyChanges::default());
        assert_eq!(of(9), KeyChanges::default());
        let long = chain(70);
        assert_eq!(long.envelopes().len(), KEY_CHANGES_MAX);
        assert_eq!(KeyChanges::check(long.envelopes()).unwrap(), long);
    }

    #[test]
    fn all_changes_are_announced_and_fit_their_limit() {
        let changes = chain(70);
        let announced = changes.announcement().unwrap();
        assert_eq!(
            KeyChanges::check(announced.key_changes.clone()),
            Ok(changes)
        );
        let bytes = serde_json::to_vec(&announced).unwrap().len();
        assert!(bytes < KEY_CHANGES_MAX * KEY_CHANGE_BYTES_MAX, "{bytes}");
        assert_eq!(KeyChanges::default().announcement(), None);
    }
}
