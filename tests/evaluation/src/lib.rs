//! The paper's evaluation and the studies beyond it, on simulated robots whose truth is known.
//!
//! Everything is seeded: the same source gives the same report, byte for byte.

pub mod drive;
pub mod error;
pub mod extent;
pub mod paper;
pub mod paper_filter;
pub mod path;
pub mod plot;
pub mod report;
pub mod robots;
pub mod scripted;
pub mod statistics;
pub mod study;

use error::EvaluationError;
use extent::Extent;
use report::{Report, Section};

/// One study: its name, and what runs it.
type Study = (
    &'static str,
    fn(&Extent) -> Result<Section, EvaluationError>,
);

/// All studies, in the report's order.
const STUDIES: [Study; 7] = [
    ("convergence", study::convergence::study),
    ("second_platform", study::second_platform::study),
    ("induced", study::induced::study),
    ("cross_track", study::cross_track::study),
    ("odometry", study::odometry::study),
    ("observability", study::observability::study),
    ("beside_paper", study::beside_paper::study),
];

/// Runs all studies, or those whose names are given, and tells each one's name as it begins.
///
/// # Errors
/// Whatever a study ends with.
pub fn evaluate(
    extent: &Extent,
    only: &[String],
    commit: &str,
    command: &str,
    mut tell: impl FnMut(&str),
) -> Result<Report, EvaluationError> {
    let mut sections = Vec::new();
    for (name, study) in STUDIES {
        if only.is_empty() || only.iter().any(|wanted| wanted == name) {
            tell(name);
            sections.push(study(extent)?);
        }
    }
    Ok(Report {
        commit: commit.to_owned(),
        command: command.to_owned(),
        extent: format!(
            "The {} evaluation: seeds 1 to {} of every case unless a study says otherwise.",
            extent.name, extent.seeds
        ),
        sections,
    })
}
