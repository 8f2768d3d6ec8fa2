//! Traits of a database behind the store: one implementation per database.

use std::collections::BTreeMap;
use std::pin::Pin;
use std::sync::Arc;

use async_trait::async_trait;
use fleetcal_domain::access::{SecretHash, SetupCode};
use fleetcal_domain::alert::Alert;
use fleetcal_domain::approval::{
    Deployment, DeploymentState, OutboxEntry, Proposal, Revision, RobotLedger,
};
use fleetcal_domain::webhook::{Delivery, Webhook};
use fleetcal_model::{
    AlertId, AuditId, Generation, Parameter, ProposalId, UserId, WallTime, WebhookId,
};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::Envelope;

use super::accounts::{SessionRecord, TokenRecord, UserRecord};
use super::alerts::{AlertFilter, AlertMoment};
use super::approvals::{AuditFilter, AuditRow, DeploymentFreeze, ProposalFilter};
use super::cluster::ClusterRegistry;
use super::error::StoreError;
use super::policy::StoredPolicy;
use super::record::{
    CheckpointRecord, CrossTrackRecord, CurrentRecord, EventRecord, PackedStatus, RobotRecord,
};
use super::webhooks::DueDelivery;

pub use super::telemetry::{Aged, Batch, EventWrite, Repetition, TelemetryWriter};
pub use super::transaction::RecordWriter;

/// An open database. Whatever keeps others from it goes with this value.
pub trait Database: std::fmt::Debug + Send + Sync + 'static {
    /// The newest migration that this program knows, or knows that it may use.
    fn schema_known(&self) -> i64;

    /// Writes over a connection of its own, to find out whether the database takes writes at all.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    fn write_once(&self) -> Pin<Box<dyn Future<Output = Result<(), StoreError>> + Send>>;

    /// The rows by which several instances agree; `None` where one service has the database.
    fn registry(&self) -> Option<Arc<dyn ClusterRegistry>> {
        None
    }
}

/// How finely the history is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Tier {
    /// Every second.
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

    /// The next coarser one.
    pub const fn coarser(self) -> Option<Self> {
        match self {
            Self::Second => Some(Self::Minute),
            Self::Minute => Some(Self::Hour),
            Self::Hour => None,
        }
    }
}

/// One parameter over one stretch of time.
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

/// One stretch of a robot's history.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// Its first second, message time.
    pub t_s: i64,
    /// Seconds of data in it.
    pub count: u32,
    /// Status of every parameter at its end.
    pub status: PackedStatus,
    /// Mean normalised innovation squared.
    pub nis: Option<f64>,
    /// The parameters that were asked for, in that order.
    pub cells: Vec<Option<Cell>>,
}

/// The part of [`Reader`] that is about access.
#[async_trait]
pub trait AccountReader {
    /// Users after number `after`, at most `limit`.
    async fn users(&self, after: i64, limit: u32) -> Result<Vec<UserRecord>, StoreError>;

    /// A user.
    async fn user(&self, id: UserId) -> Result<Option<UserRecord>, StoreError>;

    /// The user of a name, upper or lower case.
    async fn user_named(&self, name: &str) -> Result<Option<UserRecord>, StoreError>;

    /// Tokens after number `after`, at most `limit`.
    async fn tokens(&self, after: i64, limit: u32) -> Result<Vec<TokenRecord>, StoreError>;

    /// The token of a value.
    async fn token_of(&self, hash: SecretHash) -> Result<Option<TokenRecord>, StoreError>;

    /// The session of a cookie.
    async fn session_of(&self, hash: SecretHash) -> Result<Option<SessionRecord>, StoreError>;

    /// The code of a text by which the first administrator can be made.
    async fn setup_code(&self, hash: SecretHash) -> Result<Option<SetupCode>, StoreError>;
}

/// Connections that only read.
#[async_trait]
pub trait Reader: AccountReader + std::fmt::Debug + Send + Sync + 'static {
    /// Every robot, by id.
    async fn robots(&self) -> Result<Vec<RobotRecord>, StoreError>;

    /// One robot.
    async fn robot(&self, id: &RobotId) -> Result<Option<RobotRecord>, StoreError>;

    /// The latest stored estimate of every robot that has one.
    async fn current(&self) -> Result<Vec<CurrentRecord>, StoreError>;

    /// The state of every estimator.
    async fn checkpoints(&self) -> Result<Vec<CheckpointRecord>, StoreError>;

    /// The states of these robots' estimators, of those that have one.
    async fn checkpoints_of(&self, robots: &[RobotId])
    -> Result<Vec<CheckpointRecord>, StoreError>;

    /// How well every robot follows its path.
    async fn cross_tracks(&self) -> Result<Vec<CrossTrackRecord>, StoreError>;

    /// First and last second of message time that any robot has in a tier.
    async fn extent(&self, tier: Tier) -> Result<Option<(i64, i64)>, StoreError>;

    /// A robot's last second of message time.
    async fn last_second(&self, id: &RobotId) -> Result<Option<i64>, StoreError>;

    /// A robot's rows of a tier that begin in `from_s..to_s`, oldest first.
    async fn stretches(
        &self,
        id: &RobotId,
        tier: Tier,
        parameters: &[Parameter],
        from_s: i64,
        to_s: i64,
    ) -> Result<Vec<Stretch>, StoreError>;

    /// A robot's events before number `before`, newest first, at most `limit`.
    async fn events(
        &self,
        id: &RobotId,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<EventRecord>, StoreError>;

    /// The newest migration of the database.
    async fn schema_version(&self) -> Result<i64, StoreError>;

    /// The life cycle's records of every robot that has any.
    async fn ledgers(&self) -> Result<Vec<RobotLedger>, StoreError>;

    /// A signed document.
    async fn envelope(
        &self,
        robot: &RobotId,
        generation: Generation,
    ) -> Result<Option<Envelope>, StoreError>;

    /// What is to be sent, and was not.
    async fn outbox(&self) -> Result<Vec<(RobotId, OutboxEntry)>, StoreError>;

    /// Proposals with what they propose, newest first.
    async fn proposals(
        &self,
        filter: &ProposalFilter,
    ) -> Result<Vec<(Proposal, Revision)>, StoreError>;

    /// One proposal with what it proposes.
    async fn proposal(&self, id: ProposalId) -> Result<Option<(Proposal, Revision)>, StoreError>;

    /// A robot's deployments before number `before`, newest first.
    async fn deployments(
        &self,
        robot: &RobotId,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<Deployment>, StoreError>;

    /// State of what was approved, by the proposal: that of its deployment, unless a return that
    /// followed has undone it.
    async fn followed(
        &self,
        proposals: &[ProposalId],
    ) -> Result<BTreeMap<ProposalId, DeploymentState>, StoreError>;

    /// The deployment freeze.
    async fn deployment_freeze(&self) -> Result<DeploymentFreeze, StoreError>;

    /// The policy that was set.
    async fn policy(&self) -> Result<StoredPolicy, StoreError>;

    /// Rows of the audit, newest first.
    async fn audit(&self, filter: &AuditFilter) -> Result<Vec<AuditRow>, StoreError>;

    /// Rows of the audit after number `after`, oldest first, at most `limit`.
    async fn audit_after(&self, after: AuditId, limit: u32) -> Result<Vec<AuditRow>, StoreError>;

    /// Rows of the audit after number `after` that are notes about a robot, oldest first, at most `limit`.
    async fn notes_after(
        &self,
        robot: &RobotId,
        after: AuditId,
        limit: u32,
    ) -> Result<Vec<AuditRow>, StoreError>;

    /// The number of the latest row of the audit; 0 while there is none.
    async fn audit_last(&self) -> Result<AuditId, StoreError>;

    /// Every alert that is not over.
    async fn active_alerts(&self) -> Result<Vec<Alert>, StoreError>;

    /// Alerts, the most urgent first, the newest first among equals.
    async fn alerts(&self, filter: &AlertFilter) -> Result<Vec<Alert>, StoreError>;

    /// One alert with how it went, oldest change first.
    async fn alert(&self, id: AlertId) -> Result<Option<(Alert, Vec<AlertMoment>)>, StoreError>;

    /// Every webhook, oldest first.
    async fn webhooks(&self) -> Result<Vec<Webhook>, StoreError>;

    /// A webhook's deliveries before number `before`, newest first.
    async fn deliveries(
        &self,
        webhook: WebhookId,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<Delivery>, StoreError>;

    /// The oldest delivery of each webhook that is due.
    async fn due_deliveries(&self, now: WallTime) -> Result<Vec<DueDelivery>, StoreError>;

    /// How many deliveries wait.
    async fn waiting_deliveries(&self) -> Result<u64, StoreError>;

    /// Whether what is acknowledged outlives the loss of the machine of the database, because it is
    /// on a second one by then; `None` when this cannot be seen.
    async fn survives_machine_loss(&self) -> Result<Option<bool>, StoreError>;

    /// Closes the connections.
    async fn close(&self);
}
