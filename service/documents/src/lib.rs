//! Documents that the HTTP API answers with about the life cycle of calibrations and about
//! roll-outs, made from their records. It knows no route.

mod approval;
mod rollout;

pub use approval::{
    Beside, CalibrationSummary, DeploymentDocument, ProposalDocument, RevisionDocument,
    ShadowDocument,
};
pub use rollout::{LeftOutDocument, PlanDocument, PlannedRobot, PlannedWave, RolloutDocument};
