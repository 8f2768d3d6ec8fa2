//! The paper's evaluation and the studies beyond it, on simulated robots whose truth is known.
//!
//! Everything is seeded: the same source gives the same report, byte for byte.

pub mod drive;
pub mod error;
pub mod extent;
pub mod imperfect;
pub mod joining;
pub mod paper;
pub mod paper_filter;
pub mod path;
pub mod plot;
pub mod report;
pub mod results;
pub mod robots;
pub mod scripted;
pub mod statistics;
pub mod stuck;
pub mod study;

use error::EvaluationError;
use extent::Extent;
use report::{Report, Section};
use study::recording::Source;

/// A study: its name and function.
type Study = (
    &'static str,
    fn(&Extent) -> Result<Section, EvaluationError>,
);

/// The studies before the recording's, in the report's order.
const STUDIES: [Study; 10] = [
    ("convergence", study::convergence::study),
    ("second_platform", study::second_platform::study),
    ("induced", study::induced::study),
    ("cross_track", study::cross_track::study),
    ("odometry", study::odometry::study),
    ("closed_loop", study::closed_loop::study),
    ("extrinsics", study::extrinsics::study),
    ("refinement", study::refinement::study),
    ("observability", study::observability::study),
    ("beside_paper", study::beside_paper::study),
];

/// Content of an evaluation, and its description in the report.
#[derive(Debug, Clone)]
pub struct Evaluation {
    /// Extent of the driving.
    pub extent: Extent,
    /// Names of the studies; all of them when empty.
    pub only: Vec<String>,
    /// Paths of the recording and of the command that reads it.
    pub source: Source,
    /// Evaluated commit.
    pub commit: String,
    /// Command that makes the report again.
    pub command: &'static str,
}

impl Evaluation {
    /// Runs the studies, and passes each one's name to `tell` as it begins.
    ///
    /// # Errors
    /// The error of a study.
    pub fn run(&self, mut tell: impl FnMut(&str)) -> Result<Report, EvaluationError> {
        let wanted = |name: &str| self.only.is_empty() || self.only.iter().any(|one| one == name);
        let mut sections = Vec::new();
        for (name, study) in STUDIES.into_iter().filter(|(name, _)| wanted(name)) {
            tell(name);
            sections.push(study(&self.extent)?);
        }
        if wanted("recording") {
            tell("recording");
            sections.push(study::recording::study(&self.source)?);
        }
        if wanted("imperfect_robots") {
            tell("imperfect_robots");
            sections.push(study::imperfect_robots::study(&self.extent)?);
        }
        Ok(Report {
            commit: self.commit.clone(),
            command: self.command.to_owned(),
            extent: format!(
                "The {} evaluation: seeds 1 to {} of every case, unless a study says otherwise; equal \
                 seeds give equal numbers.",
                self.extent.name, self.extent.seeds
            ),
            sections,
        })
    }
}
