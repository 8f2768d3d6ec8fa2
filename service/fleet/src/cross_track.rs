//! Cross-track error that a robot reports itself: one histogram for each calibration that
//! it has used.

use std::collections::{BTreeMap, BTreeSet};

use fleetcal_domain::robot::{CrossTrack, GENERATIONS_MAX};
use fleetcal_model::{Generation, RobotTime};
use fleetcal_proto::calibration::CalibrationValues;
use fleetcal_proto::encoding::Encoding;
use fleetcal_proto::event::CrossTrackError;
use fleetcal_proto::ros::{Float64, RosMessage};

/// Largest error that counts as path following, m.
const ERROR_MAX_M: f64 = 100.0;

/// Values that a robot compensates with, and the start of their use.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UsedValues {
    /// Start of their use, ns since 1970 by the clock of the robot's agent, which may differ from
    /// the one that stamps its messages.
    pub since: RobotTime,
    /// Generation of their document; 0 for its factory calibration.
    pub generation: Generation,
    /// The values.
    pub values: CalibrationValues,
}

/// Least interval between errors that make a bend, ns: a second, less the jitter of clocks.
const APART_NS: i64 = 900_000_000;
/// Largest interval between errors that make a bend, ns.
const APART_MAX_NS: i64 = 2_500_000_000;

/// The latest errors, about a second apart.
#[derive(Debug, Clone, Copy)]
struct Recent {
    generation: Generation,
    at_ns: i64,
    error_m: f64,
    before_m: Option<f64>,
}

/// Histograms of one robot by generation; 0 covers its driving before any calibration was applied.
#[derive(Debug, Clone, Default)]
pub struct CrossTracks {
    by_generation: BTreeMap<Generation, CrossTrack>,
    recent: Option<Recent>,
    /// Generations that have changed since they were last collected for the store.
    unsaved: BTreeSet<Generation>,
}

impl CrossTracks {
    /// Restores stored histograms.
    pub fn of(stored: BTreeMap<Generation, CrossTrack>) -> Self {
        Self {
            by_generation: stored,
            recent: None,
            unsaved: BTreeSet::new(),
        }
    }

    /// Adds an error at `at_ns` of a robot that used `generation` then.
    pub fn add(&mut self, generation: Generation, at_ns: i64, error_m: f64) {
        let bend = self.bend(generation, at_ns, error_m);
        let errors = self.by_generation.entry(generation).or_default();
        errors.add(error_m);
        if let Some(bend) = bend {
            errors.add_bend(bend);
        }
        self.unsaved.insert(generation);
        // What it drove with at first stays: it is what all others are held against.
        while self.by_generation.len() > GENERATIONS_MAX {
            let Some(oldest) = self
                .by_generation
                .keys()
                .copied()
                .find(|one| !one.is_factory())
            else {
                return;
            };
            self.by_generation.remove(&oldest);
            self.unsaved.remove(&oldest);
        }
    }

    /// Returns the three errors of the bend that this error completes.
    fn bend(&mut self, generation: Generation, at_ns: i64, error_m: f64) -> Option<[f64; 3]> {
        let recent = self.recent.filter(|recent| {
            let after_ns = at_ns.saturating_sub(recent.at_ns);
            recent.generation == generation && (0..=APART_MAX_NS).contains(&after_ns)
        });
        if recent.is_some_and(|recent| at_ns - recent.at_ns < APART_NS) {
            return None;
        }
        self.recent = Some(Recent {
            generation,
            at_ns,
            error_m,
            before_m: recent.map(|recent| recent.error_m),
        });
        let recent = recent?;
        Some([recent.before_m?, recent.error_m, error_m])
    }

    /// All histograms by generation.
    pub fn all(&self) -> &BTreeMap<Generation, CrossTrack> {
        &self.by_generation
    }

    /// Returns the histograms that have changed since the last call.
    pub fn take_unsaved(&mut self) -> Vec<(Generation, CrossTrack)> {
        let unsaved = std::mem::take(&mut self.unsaved).into_iter();
        unsaved
            .filter_map(|one| Some((one, self.by_generation.get(&one)?.clone())))
            .collect()
    }
}

/// Reads a robot's message: its own stamp, if any, and the error in metres.
///
/// # Errors
/// A sentence that names the invalid field.
pub fn read(encoding: Encoding, payload: &[u8]) -> Result<(Option<RobotTime>, f64), String> {
    let (stamp_ns, error_m) = match encoding {
        Encoding::Json => {
            let error: CrossTrackError = serde_json::from_slice(payload)
                .map_err(|error| format!("cross_track_error: {error}"))?;
            (Some(error.stamp_ns), error.value_m)
        }
        Encoding::Cdr => {
            let message = Float64::from_cdr(payload);
            let message = message.map_err(|error| format!("cross_track_error: {error}"))?;
            (None, message.data)
        }
    };
    if !(-ERROR_MAX_M..=ERROR_MAX_M).contains(&error_m) {
        return Err(format!(
            "cross_track_error: value_m: got {error_m}, expected -{ERROR_MAX_M} to {ERROR_MAX_M}"
        ));
    }
    Ok((stamp_ns, error_m))
}

#[cfg(test)]
mod simulated;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_fall_into_their_bins_and_none_is_lost() {
        let mut errors = CrossTrack::default();
        for error_m in [-3.0, -0.5, -0.001, 0.0, 0.009, 0.499, 7.0] {
            errors.add(error_m);
        }
        assert_eq!(errors.bins.iter().sum::<u64>(), errors.count);
        assert_eq!(
            (errors.bins[0], errors.bins[49], errors.bins[50]),
            (2, 1, 2)
        );
        assert_eq!(errors.bins[99], 2);
    }

    #[test]
    fn the_first_and_the_latest_calibrations_are_kept() {
        let mut tracks = CrossTracks::default();
        for generation in 0..20 {
            tracks.add(Generation(generation), 0, 0.1);
        }
        let kept: Vec<Generation> = tracks.all().keys().copied().collect();
        assert_eq!(kept, [0, 13, 14, 15, 16, 17, 18, 19].map(Generation));
        assert_eq!(tracks.take_unsaved().len(), 8);
        assert!(tracks.take_unsaved().is_empty());
    }

    #[test]
    fn both_forms_are_read_and_nonsense_is_named() {
        let json = br#"{"stamp_ns": 7, "value_m": -0.25}"#;
        assert_eq!(read(Encoding::Json, json), Ok((Some(RobotTime(7)), -0.25)));
        let mut cdr = vec![0, 1, 0, 0];
        cdr.extend(0.5_f64.to_le_bytes());
        assert_eq!(read(Encoding::Cdr, &cdr), Ok((None, 0.5)));
        assert!(
            read(Encoding::Json, b"{}")
                .unwrap_err()
                .contains("stamp_ns")
        );
        let far = br#"{"stamp_ns": 7, "value_m": 1e9}"#;
        assert!(read(Encoding::Json, far).unwrap_err().contains("expected"));
    }
}
