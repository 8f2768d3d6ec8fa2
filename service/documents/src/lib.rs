//! Documents that the HTTP API answers with about the life cycle of calibrations, made from its
//! records. It knows no route.

mod approval;

pub use approval::{
    Beside, CalibrationSummary, DeploymentDocument, ProposalDocument, RevisionDocument,
    ShadowDocument,
};
