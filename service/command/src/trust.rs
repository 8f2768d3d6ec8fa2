//! Keys by which signed documents are checked, as flags of the commands that need no service.

use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use clap::Args;
use fleetcal_proto::calibration::Envelope;
use fleetcal_proto::key_change::{KEY_CHANGES_MAX, KeyChanges};
use fleetcal_proto::signing::{EnvelopeRefused, PublicKey, TrustedKeys};
use serde::Deserialize;

use crate::CommandError;

/// Longest answer of a service that is read, bytes.
const ANSWER_BYTES_MAX: u64 = 2048 * KEY_CHANGES_MAX as u64;

/// Flag that names changes of key.
#[derive(Debug, Clone, Default, Args)]
pub struct ChangesArgument {
    /// The service's answer to `GET /api/v1/signing-key`, in a file: keys that replaced a --key are
    /// trusted too
    #[arg(long, value_name = "FILE", requires = "key")]
    pub key_changes: Option<PathBuf>,
}

/// Keys that are trusted, and those that are known.
#[derive(Debug, Clone)]
pub struct Trust {
    /// Keys that are trusted.
    pub trusted: TrustedKeys,
    changes: KeyChanges,
}

/// The part of the answer that counts.
#[derive(Debug, Deserialize)]
struct Answer {
    changes: Vec<Envelope>,
}

impl ChangesArgument {
    /// Returns the trust in `keys` and in those that replaced them.
    ///
    /// # Errors
    /// Too many keys, or a file that cannot be read or used.
    pub fn trust(&self, keys: &[PublicKey]) -> Result<Trust, CommandError> {
        let trusted = TrustedKeys::new(keys.to_vec()).map_err(CommandError::VerifyKeys)?;
        let changes = self.key_changes.as_deref().map(read).transpose()?;
        let changes = changes.unwrap_or_default();
        Ok(Trust {
            trusted: changes.followed_from(&trusted),
            changes,
        })
    }
}

impl Trust {
    /// Returns a refusal in words, with the key that it needs where a change names it.
    pub fn in_words(&self, refused: &EnvelopeRefused) -> String {
        let EnvelopeRefused::KeyUnknown { key_id, .. } = refused else {
            return refused.to_string();
        };
        let former = self.changes.former_keys().into_iter();
        match former.into_iter().find(|key| key.id() == *key_id) {
            Some(key) => format!("{refused}; it was replaced since: give --key {key} as well"),
            None => format!(
                "{refused}; give the --key of that id, or the --key-changes that lead to it"
            ),
        }
    }
}

fn read(path: &Path) -> Result<KeyChanges, CommandError> {
    let mut text = Vec::new();
    let read = File::open(path).and_then(|file| file.take(ANSWER_BYTES_MAX).read_to_end(&mut text));
    read.map_err(|source| CommandError::Read {
        path: path.to_owned(),
        source,
    })?;
    let refused = |reason: String| CommandError::KeyChanges {
        path: path.to_owned(),
        reason,
    };
    let answer: Answer =
        serde_json::from_slice(&text).map_err(|error| refused(error.to_string()))?;
    KeyChanges::check(answer.changes).map_err(|error| refused(error.to_string()))
}
