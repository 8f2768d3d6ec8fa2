//! Stored state of a calibrator, from which another one continues.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::comparison::{Comparison, Occasion};
use super::drift::Baseline;
use super::session::Session;
use super::{Calibrator, CalibratorConfig};
use crate::change::ChangeWatch;
use crate::change::long_run::LongRunVariance;
use crate::filter::Filter;
use crate::filter::follow::Follower;
use crate::lidar_odometry::LearntScanner;
use crate::merge::{Merger, Stream};
use crate::stream::Note;
use crate::trust::Trust;

/// Former versions of the layout that can be read as well: 8 lacks the steering's lag, 7 the
/// steering's curve too, 6 the scanner too.
const VERSIONS_BEFORE: [u32; 3] = [6, 7, 8];

/// A calibrator's state, to be stored and restored. The local map is not in it: it is rebuilt.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Checkpoint {
    version: u32,
    filter: Option<Filter>,
    session: Session,
    trust: Trust,
    long_run: LongRunVariance,
    comparison: Option<Comparison>,
    baseline: Option<Baseline>,
    #[serde(default)]
    scanner: Option<LearntScanner>,
    /// Stream of the last message that left the merger, which has the stamp of the session: an
    /// estimator that continues from here has received that message, and those before it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    left: Option<Stream>,
    /// Notes that the merger of a former version held until their stamps were reached.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    notes: Vec<Note>,
    /// True if a report of a reassembly waits for its verdict.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    reassembly_open: bool,
}

/// Reason for which a checkpoint was refused.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum CheckpointRefused {
    /// Checkpoint that another version of the estimator wrote.
    #[error("the checkpoint is of version {found}, this estimator reads version {wanted}")]
    Version {
        /// Version in the checkpoint.
        found: u32,
        /// Version that can be read.
        wanted: u32,
    },
}

impl Checkpoint {
    /// Version of the layout that is written. A program that raises it has to store it as a new
    /// format as well: an instance of the version before would otherwise claim a robot whose state
    /// it cannot read.
    pub const VERSION: u32 = 9;
}

impl Calibrator {
    /// Continues from a checkpoint, under a new anchor and local map. Its session continues too,
    /// unless its next stamps begin another.
    ///
    /// # Errors
    /// Returns an error when the checkpoint is of another version.
    pub fn restore(
        config: CalibratorConfig,
        checkpoint: &Checkpoint,
    ) -> Result<Self, CheckpointRefused> {
        let is_older = VERSIONS_BEFORE.contains(&checkpoint.version);
        if checkpoint.version != Checkpoint::VERSION && !is_older {
            return Err(CheckpointRefused::Version {
                found: checkpoint.version,
                wanted: Checkpoint::VERSION,
            });
        }
        let mut restored = Self::new(config);
        if let Some(learnt) = checkpoint.scanner.clone() {
            restored = restored.with_scanner(learnt);
        }
        if checkpoint.session.began.is_some() {
            restored.merger = Merger::resuming(checkpoint.session.now, checkpoint.left);
        }
        restored.follower = checkpoint.filter.clone().map(|mut filter| {
            filter.set_motion_noise(&restored.config.settings);
            if is_older {
                filter.open_curve(&restored.prior);
            }
            Follower::new(filter)
        });
        restored.session = checkpoint.session.clone();
        restored.trust = checkpoint.trust.clone();
        restored.watch = ChangeWatch::with_long_run(checkpoint.long_run.clone());
        restored.comparison.clone_from(&checkpoint.comparison);
        if let Some(stored) = restored.comparison.as_mut().filter(|_| is_older) {
            stored.open_curve(&restored.prior, &restored.config.settings);
        }
        restored.baseline.clone_from(&checkpoint.baseline);
        let is_reassembled = |stored: &Comparison| stored.occasion == Occasion::Reassembled;
        restored.reassembly_open = checkpoint.reassembly_open
            || checkpoint.comparison.as_ref().is_some_and(is_reassembled);
        for note in &checkpoint.notes {
            restored.take_note(note, &mut Vec::new());
        }
        Ok(restored)
    }

    /// State that has to be stored to continue later.
    pub fn checkpoint(&self) -> Checkpoint {
        // What is measured from the anchor and the local map ends with them.
        let mut long_run = self.watch.long_run().clone();
        long_run.break_block();
        Checkpoint {
            version: Checkpoint::VERSION,
            filter: self
                .filter()
                .filter(|_| self.failed_pass.is_none())
                .map(|filter| {
                    let mut filter = filter.clone();
                    filter.lose_anchor();
                    filter
                }),
            session: self.session.stored(),
            trust: self.trust.clone(),
            long_run,
            comparison: self.comparison.clone(),
            baseline: self.baseline.clone(),
            scanner: Some(self.learnt_scanner()),
            left: self.merger.left(),
            notes: Vec::new(),
            reassembly_open: self.reassembly_open,
        }
    }
}
