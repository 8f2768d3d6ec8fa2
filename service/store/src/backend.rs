//! Traits of a database behind the store: one implementation per database.

use std::collections::BTreeMap;
use std::pin::Pin;
use std::sync::Arc;

use async_trait::async_trait;
use fleetcal_domain::access::{SecretHash, SetupCode};
use fleetcal_domain::alert::{Alert, StoredAlert};
use fleetcal_domain::approval::{
    Deployment, DeploymentState, OutboxEntry, Proposal, Revision, RobotLedger,
};
use fleetcal_domain::webhook::{Delivery, Webhook};
use fleetcal_model::{
    AlertId, AuditId, DeploymentId, Generation, Parameter, ProposalId, RolloutId, UserId, WallTime,
    WebhookId,
};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::Envelope;
use fleetcal_rollout::{Followed, Rollout};

use super::accounts::{SessionRecord, TokenRecord, UserRecord};
use super::alerts::{AlertFilter, AlertMoment};
use super::approvals::{AuditFilter, DeploymentFreeze, ProposalFilter};
use super::audit::AuditRow;
use super::certificates::{CertificateFilter, CertificateRecord};
use super::cluster::ClusterRegistry;
use super::error::StoreError;
use super::policy::StoredPolicy;
use super::record::{
    CheckpointRecord, CrossTrackRecord, CurrentRecord, EventRecord, PackedStatus, RobotRecord,
};
use super::rollouts::RolloutFilter;
use super::webhooks::DueDelivery;

pub use super::telemetry::{Aged, Batch, EventWrite, Repetition, TelemetryWriter};
pub use super::transaction::RecordWriter;

/// Open database, with the lock that keeps other processes away from it.
pub trait Database: std::fmt::Debug + Send + Sync + 'static {
    /// Newest migration that this program knows, or knows that it may use.
    fn schema_known(&self) -> i64;

    /// Writes over a connection of its own, to test whether the database accepts writes.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    fn write_once(&self) -> Pin<Box<dyn Future<Output = Result<(), StoreError>> + Send>>;

    /// Registry of the cluster's instances; `None` if a single service has the database.
    fn registry(&self) -> Option<Arc<dyn ClusterRegistry>> {
        None
    }
}

/// Resolution of a part of the history.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Tier {
    /// Seconds.
    Second,
    /// Roll-ups of a minute.
    Minute,
    /// Roll-ups of an hour.
    Hour,
}

impl Tier {
    /// Length of one row, s.
    pub const fn seconds(self) -> i64 {
        match self {
            Self::Second => 1,
            Self::Minute => 60,
            Self::Hour => 3_600,
        }
    }

    /// Next coarser tier.
    pub const fn coarser(self) -> Option<Self> {
        match self {
            Self::Second => Some(Self::Minute),
            Self::Minute => Some(Self::Hour),
            Self::Hour => None,
        }
    }
}

/// Statistics of one parameter over a stretch of time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// Mean value.
    pub mean: f64,
    /// Lowest value.
    pub min: f64,
    /// Highest value.
    pub max: f64,
    /// Mean of the sigmas.
    pub sigma: f64,
}

/// Stretch of a robot's history.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// First second, message time.
    pub t_s: i64,
    /// Seconds of data in it.
    pub count: u32,
    /// Status of every parameter at its end.
    pub status: PackedStatus,
    /// Mean normalised innovation squared.
    pub nis: Option<f64>,
    /// Requested parameters, in the request's order.
    pub cells: Vec<Option<Cell>>,
}

/// Reader of users, sessions and tokens, a part of [`Reader`].
#[async_trait]
pub trait AccountReader {
    /// Users after number `after`, at most `limit`.
    async fn users(&self, after: i64, limit: u32) -> Result<Vec<UserRecord>, StoreError>;

    /// Reads one user.
    async fn user(&self, id: UserId) -> Result<Option<UserRecord>, StoreError>;

    /// Finds the user of a name, upper or lower case.
    async fn user_named(&self, name: &str) -> Result<Option<UserRecord>, StoreError>;

    /// Tokens after number `after`, at most `limit`.
    async fn tokens(&self, after: i64, limit: u32) -> Result<Vec<TokenRecord>, StoreError>;

    /// Finds the token of a value.
    async fn token_of(&self, hash: SecretHash) -> Result<Option<TokenRecord>, StoreError>;

    /// Finds the session of a cookie.
    async fn session_of(&self, hash: SecretHash) -> Result<Option<SessionRecord>, StoreError>;

    /// Finds the set-up code of a text, with which the first administrator is created.
    async fn setup_code(&self, hash: SecretHash) -> Result<Option<SetupCode>, StoreError>;
}

/// Connections for reading.
#[async_trait]
pub trait Reader: AccountReader + std::fmt::Debug + Send + Sync + 'static {
    /// Every robot, by id.
    async fn robots(&self) -> Result<Vec<RobotRecord>, StoreError>;

    /// Reads one robot.
    async fn robot(&self, id: &RobotId) -> Result<Option<RobotRecord>, StoreError>;

    /// The latest stored estimate of every robot that has one.
    async fn current(&self) -> Result<Vec<CurrentRecord>, StoreError>;

    /// Checkpoints of all robots.
    async fn checkpoints(&self) -> Result<Vec<CheckpointRecord>, StoreError>;

    /// Checkpoints of these robots; robots without one are absent.
    async fn checkpoints_of(&self, robots: &[RobotId])
    -> Result<Vec<CheckpointRecord>, StoreError>;

    /// Cross-track errors of every robot.
    async fn cross_tracks(&self) -> Result<Vec<CrossTrackRecord>, StoreError>;

    /// First and last second of message time that any robot has in a tier.
    async fn extent(&self, tier: Tier) -> Result<Option<(i64, i64)>, StoreError>;

    /// Last second of a robot's messages.
    async fn last_second(&self, id: &RobotId) -> Result<Option<i64>, StoreError>;

    /// Rows of a robot and tier that begin in `from_s..to_s`, oldest first.
    async fn stretches(
        &self,
        id: &RobotId,
        tier: Tier,
        parameters: &[Parameter],
        from_s: i64,
        to_s: i64,
    ) -> Result<Vec<Stretch>, StoreError>;

    /// Events of a robot before number `before`, newest first, at most `limit`.
    async fn events(
        &self,
        id: &RobotId,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<EventRecord>, StoreError>;

    /// Newest migration of the database.
    async fn schema_version(&self) -> Result<i64, StoreError>;

    /// Records of the life cycle, of every robot that has any.
    async fn ledgers(&self) -> Result<Vec<RobotLedger>, StoreError>;

    /// Reads a signed document.
    async fn envelope(
        &self,
        robot: &RobotId,
        generation: Generation,
    ) -> Result<Option<Envelope>, StoreError>;

    /// Messages to robots that were not sent yet.
    async fn outbox(&self) -> Result<Vec<(RobotId, OutboxEntry)>, StoreError>;

    /// Proposals with their revisions, newest first.
    async fn proposals(
        &self,
        filter: &ProposalFilter,
    ) -> Result<Vec<(Proposal, Revision)>, StoreError>;

    /// Reads a proposal with its revision.
    async fn proposal(&self, id: ProposalId) -> Result<Option<(Proposal, Revision)>, StoreError>;

    /// Deployments of a robot before number `before`, newest first.
    async fn deployments(
        &self,
        robot: &RobotId,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<Deployment>, StoreError>;

    /// State of the calibrations that were approved, by proposal: the deployment's, unless a later
    /// return has undone it.
    async fn followed(
        &self,
        proposals: &[ProposalId],
    ) -> Result<BTreeMap<ProposalId, DeploymentState>, StoreError>;

    /// Certificates, newest first.
    async fn certificates(
        &self,
        filter: &CertificateFilter,
    ) -> Result<Vec<CertificateRecord>, StoreError>;

    /// Reads one certificate.
    async fn certificate(
        &self,
        number: DeploymentId,
    ) -> Result<Option<CertificateRecord>, StoreError>;

    /// Roll-outs, newest first.
    async fn rollouts(&self, filter: &RolloutFilter) -> Result<Vec<Rollout>, StoreError>;

    /// Reads one roll-out.
    async fn rollout(&self, id: RolloutId) -> Result<Option<Rollout>, StoreError>;

    /// Robots of a roll-out with the present states of their proposals, by wave and id.
    async fn rollout_robots(&self, id: RolloutId) -> Result<Vec<Followed>, StoreError>;

    /// Reads the deployment freeze.
    async fn deployment_freeze(&self) -> Result<DeploymentFreeze, StoreError>;

    /// Reads the stored policy.
    async fn policy(&self) -> Result<StoredPolicy, StoreError>;

    /// Rows of the audit, newest first.
    async fn audit(&self, filter: &AuditFilter) -> Result<Vec<AuditRow>, StoreError>;

    /// Rows of the audit after number `after`, oldest first, at most `limit`.
    async fn audit_after(&self, after: AuditId, limit: u32) -> Result<Vec<AuditRow>, StoreError>;

    /// Notes about a robot in the audit after number `after`, oldest first, at most `limit`.
    async fn notes_after(
        &self,
        robot: &RobotId,
        after: AuditId,
        limit: u32,
    ) -> Result<Vec<AuditRow>, StoreError>;

    /// Number of the latest row of the audit; 0 if there is none.
    async fn audit_last(&self) -> Result<AuditId, StoreError>;

    /// Every alert of a known kind and condition that has not ended.
    async fn active_alerts(&self) -> Result<Vec<Alert>, StoreError>;

    /// Alerts, the most urgent first, the newest first among equals.
    async fn alerts(&self, filter: &AlertFilter) -> Result<Vec<StoredAlert>, StoreError>;

    /// Reads an alert with its changes, oldest first.
    async fn alert(
        &self,
        id: AlertId,
    ) -> Result<Option<(StoredAlert, Vec<AlertMoment>)>, StoreError>;

    /// Every webhook, oldest first.
    async fn webhooks(&self) -> Result<Vec<Webhook>, StoreError>;

    /// Deliveries of a webhook before number `before`, newest first.
    async fn deliveries(
        &self,
        webhook: WebhookId,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<Delivery>, StoreError>;

    /// Oldest due delivery of each webhook.
    async fn due_deliveries(&self, now: WallTime) -> Result<Vec<DueDelivery>, StoreError>;

    /// Number of waiting deliveries.
    async fn waiting_deliveries(&self) -> Result<u64, StoreError>;

    /// True if acknowledged writes survive the loss of the database's machine, as a second one has
    /// them by then; `None` if this cannot be determined.
    async fn survives_machine_loss(&self) -> Result<Option<bool>, StoreError>;

    /// Closes the connections.
    async fn close(&self);
}
