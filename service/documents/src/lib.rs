//! Documents that the HTTP API answers with about the life cycle of calibrations and its rules,
//! roll-outs, and the instances of a cluster, made from their records. It knows no route.

mod approval;
mod cluster;
mod rollout;
mod rules;

pub use approval::{
    Beside, CalibrationSummary, DeploymentDocument, ProposalDocument, RevisionDocument,
    ShadowDocument,
};
pub use cluster::ClusterDocument;
pub use rollout::{
    LeftOutDocument, PlanDocument, PlannedRobot, PlannedWave, RolloutDocument, RolloutPage,
    RolloutRequest,
};
pub use rules::{FreezeBody, FreezeDocument, PolicyBody, PolicyDocument};
