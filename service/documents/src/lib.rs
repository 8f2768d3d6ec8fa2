//! Documents that the HTTP API answers with about the life cycle of calibrations and its rules,
//! roll-outs, webhooks, and the instances of a cluster, made from their records. It knows no route.

mod approval;
mod cluster;
mod rollout;
mod rules;
mod webhooks;

pub use approval::{
    Beside, CalibrationSummary, DeploymentDocument, ProposalDocument, RevisionDocument,
    ShadowDocument,
};
pub use cluster::ClusterDocument;
pub use rollout::{
    LeftOutDocument, PlanDocument, PlannedRobot, PlannedWave, ResumeRequest, RolloutDocument,
    RolloutPage, RolloutRequest, against,
};
pub use rules::{FreezeBody, FreezeDocument, PolicyBody, PolicyDocument};
pub use webhooks::{
    DeliveryDocument, DeliveryPage, NewWebhookBody, SecretDocument, WebhookDocument, WebhookList,
};
