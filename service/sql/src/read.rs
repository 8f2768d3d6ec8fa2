//! The connections that only read.

use std::collections::BTreeMap;

use async_trait::async_trait;
use fleetcal_domain::alert::{Alert, StoredAlert};
use fleetcal_domain::approval::{
    Deployment, DeploymentState, OutboxEntry, Proposal, Revision, RobotLedger,
};
use fleetcal_domain::webhook::{Delivery, Webhook};
use fleetcal_model::{
    AlertId, AuditId, DeploymentId, Generation, Parameter, ProposalId, RolloutId, WallTime,
    WebhookId,
};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::Envelope;
use fleetcal_rollout::{Followed, Rollout};
use fleetcal_store::backend::{Cell, Reader, Stretch, Tier};
use fleetcal_store::{
    AlertFilter, AlertMoment, AuditFilter, AuditRow, CertificateFilter, CertificateRecord,
    CheckpointRecord, CrossTrackRecord, CurrentRecord, DeploymentFreeze, DueDelivery, EventRecord,
    PackedStatus, ProposalFilter, RobotRecord, RolloutFilter, StoreError, StoredPolicy,
};

use super::connection::{Connection, Pool, StatementError};
use super::dialect::Dialect;
use super::query::{query, query_scalar};
use super::row::{column, corrupt, json, parsed, robot_id, robot_time, wall_time};
use super::statement::Statement;
use super::value::Row;
use super::{alerts, certificates, events, history, policy, records, robots, rollouts, webhooks};

/// Reads estimators' states for [`checkpoint_of`].
const CHECKPOINTS: &str = "SELECT r.id, c.stamp_ns, c.received_ns, c.state
    FROM checkpoint AS c JOIN robot AS r ON r.key = c.robot";

/// Reader over a pool of connections.
#[derive(Debug)]
pub struct SqlReader {
    pool: Box<dyn Pool>,
}

impl SqlReader {
    /// Makes a reader over these connections.
    pub fn new(pool: impl Pool) -> Self {
        Self {
            pool: Box::new(pool),
        }
    }

    /// Returns a connection for one statement.
    pub(crate) fn connection(&self) -> Pooled<'_> {
        Pooled(self.pool.as_ref())
    }
}

/// A pool in the role of a connection: each statement uses one of its own.
pub(crate) struct Pooled<'p>(&'p dyn Pool);

#[async_trait]
impl Connection for Pooled<'_> {
    fn dialect(&self) -> Dialect {
        self.0.dialect()
    }

    async fn rows(&mut self, statement: Statement) -> Result<Vec<Row>, StatementError> {
        self.0.rows(statement).await
    }

    async fn execute(&mut self, statement: Statement) -> Result<u64, StatementError> {
        Ok(self.0.rows(statement).await?.len() as u64)
    }
}

#[async_trait]
impl Reader for SqlReader {
    async fn robots(&self) -> Result<Vec<RobotRecord>, StoreError> {
        let rows = query(robots::SELECT_ALL)
            .fetch_all(&mut self.connection())
            .await
            .map_err(StoreError::database("read the robots"))?;
        rows.iter().map(robots::robot_of).collect()
    }

    async fn robot(&self, id: &RobotId) -> Result<Option<RobotRecord>, StoreError> {
        let row = query(robots::SELECT_ONE)
            .bind(id.as_str())
            .fetch_optional(&mut self.connection())
            .await
            .map_err(StoreError::database("read a robot"))?;
        row.as_ref().map(robots::robot_of).transpose()
    }

    async fn current(&self) -> Result<Vec<CurrentRecord>, StoreError> {
        let rows = query("SELECT received_ns, estimate FROM robot_current ORDER BY robot")
            .fetch_all(&mut self.connection())
            .await
            .map_err(StoreError::database("read the latest estimates"))?;
        rows.iter()
            .map(|row| {
                let estimate: String = column(row, "robot_current", 1)?;
                Ok(CurrentRecord {
                    received_ns: wall_time(row, "robot_current", 0)?,
                    estimate: parsed("robot_current", &estimate)?,
                })
            })
            .collect()
    }

    async fn checkpoints(&self) -> Result<Vec<CheckpointRecord>, StoreError> {
        let rows = query(format!("{CHECKPOINTS} ORDER BY r.id"))
            .fetch_all(&mut self.connection())
            .await
            .map_err(StoreError::database("read the estimators' states"))?;
        rows.iter().map(checkpoint_of).collect()
    }

    async fn checkpoints_of(
        &self,
        robots: &[RobotId],
    ) -> Result<Vec<CheckpointRecord>, StoreError> {
        let elements = self.pool.dialect().elements();
        let asked =
            format!("{CHECKPOINTS} WHERE r.id IN (SELECT value FROM {elements}) ORDER BY r.id");
        let rows = query(asked)
            .bind(json("robot", &robots)?)
            .fetch_all(&mut self.connection())
            .await
            .map_err(StoreError::database("read estimators' states"))?;
        rows.iter().map(checkpoint_of).collect()
    }

    async fn cross_tracks(&self) -> Result<Vec<CrossTrackRecord>, StoreError> {
        let rows =
            query("SELECT robot, generation, errors FROM cross_track ORDER BY robot, generation")
                .fetch_all(&mut self.connection())
                .await
                .map_err(StoreError::database("read how robots follow their paths"))?;
        rows.iter()
            .map(|row| {
                let generation: i64 = column(row, "cross_track", 1)?;
                let errors: String = column(row, "cross_track", 2)?;
                Ok(CrossTrackRecord {
                    robot: robot_id(row, "cross_track", 0)?,
                    generation: Generation(generation.unsigned_abs()),
                    errors: parsed("cross_track", &errors)?,
                })
            })
            .collect()
    }

    async fn extent(&self, tier: Tier) -> Result<Option<(i64, i64)>, StoreError> {
        let table = history::table(tier);
        let row = query(history::extent(self.pool.dialect(), tier))
            .fetch_one(&mut self.connection())
            .await
            .map_err(StoreError::database("read the extent of the history"))?;
        let first: Option<i64> = column(&row, table, 0)?;
        let last: Option<i64> = column(&row, table, 1)?;
        Ok(first.zip(last))
    }

    async fn last_second(&self, id: &RobotId) -> Result<Option<i64>, StoreError> {
        let failed = || StoreError::database("read the latest estimate");
        let stamp_ns: Option<i64> = query_scalar(
            "SELECT stamp_ns FROM robot_current
             WHERE robot = (SELECT key FROM robot WHERE id = $1)",
        )
        .bind(id.as_str())
        .fetch_optional(&mut self.connection())
        .await
        .map_err(failed())?;
        Ok(stamp_ns.map(|stamp_ns| stamp_ns.div_euclid(1_000_000_000)))
    }

    async fn stretches(
        &self,
        id: &RobotId,
        tier: Tier,
        parameters: &[Parameter],
        from_s: i64,
        to_s: i64,
    ) -> Result<Vec<Stretch>, StoreError> {
        let failed = || StoreError::database("read a robot's history");
        let key: Option<i64> = query_scalar("SELECT key FROM robot WHERE id = $1")
            .bind(id.as_str())
            .fetch_optional(&mut self.connection())
            .await
            .map_err(failed())?;
        let Some(key) = key else {
            return Ok(Vec::new());
        };
        let rows = history::select(self.pool.dialect(), tier, parameters)
            .bind(from_s)
            .bind(to_s)
            .bind(key)
            .fetch_all(&mut self.connection())
            .await
            .map_err(failed())?;
        rows.iter()
            .map(|row| stretch_of(row, tier, parameters.len()))
            .collect()
    }

    async fn events(
        &self,
        id: &RobotId,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<EventRecord>, StoreError> {
        let rows = query(
            "SELECT e.id, r.id, e.kind, e.stamp_ns, e.received_ns, e.source, e.author, e.note,
                 e.details
             FROM robot_event AS e JOIN robot AS r ON r.key = e.robot
             WHERE r.id = $1 AND e.id < $2 ORDER BY e.id DESC LIMIT $3",
        )
        .bind(id.as_str())
        .bind(before.unwrap_or(i64::MAX))
        .bind(limit)
        .fetch_all(&mut self.connection())
        .await
        .map_err(StoreError::database("read a robot's events"))?;
        rows.iter()
            .map(|row| events::event_of(row, false))
            .collect()
    }

    async fn schema_version(&self) -> Result<i64, StoreError> {
        schema_version(&mut self.connection()).await
    }

    async fn survives_machine_loss(&self) -> Result<Option<bool>, StoreError> {
        match self.pool.dialect() {
            // One file, on one machine.
            Dialect::Sqlite => Ok(Some(false)),
            // A role without `pg_read_all_stats` sees that there are standbys and not which.
            Dialect::Postgres => query_scalar(
                "SELECT CASE
                     WHEN current_setting('synchronous_commit') IN ('off', 'local')
                         OR current_setting('synchronous_standby_names') = '' THEN false
                     ELSE (SELECT bool_or(sync_state IN ('sync', 'quorum'))
                         FROM pg_stat_replication)
                 END",
            )
            .fetch_one(&mut self.connection())
            .await
            .map_err(StoreError::database("say how many copies there are")),
        }
    }

    async fn ledgers(&self) -> Result<Vec<RobotLedger>, StoreError> {
        records::ledgers(&mut self.connection()).await
    }

    async fn envelope(
        &self,
        robot: &RobotId,
        generation: Generation,
    ) -> Result<Option<Envelope>, StoreError> {
        records::envelope(&mut self.connection(), robot, generation).await
    }

    async fn outbox(&self) -> Result<Vec<(RobotId, OutboxEntry)>, StoreError> {
        records::outbox(&mut self.connection()).await
    }

    async fn proposals(
        &self,
        filter: &ProposalFilter,
    ) -> Result<Vec<(Proposal, Revision)>, StoreError> {
        records::proposals(&mut self.connection(), filter).await
    }

    async fn proposal(&self, id: ProposalId) -> Result<Option<(Proposal, Revision)>, StoreError> {
        records::proposal(&mut self.connection(), id).await
    }

    async fn deployments(
        &self,
        robot: &RobotId,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<Deployment>, StoreError> {
        records::deployments(&mut self.connection(), robot, before, limit).await
    }

    async fn followed(
        &self,
        proposals: &[ProposalId],
    ) -> Result<BTreeMap<ProposalId, DeploymentState>, StoreError> {
        records::followed(&mut self.connection(), proposals).await
    }

    async fn certificates(
        &self,
        filter: &CertificateFilter,
    ) -> Result<Vec<CertificateRecord>, StoreError> {
        certificates::certificates(&mut self.connection(), filter).await
    }

    async fn certificate(
        &self,
        number: DeploymentId,
    ) -> Result<Option<CertificateRecord>, StoreError> {
        certificates::certificate(&mut self.connection(), number).await
    }

    async fn rollouts(&self, filter: &RolloutFilter) -> Result<Vec<Rollout>, StoreError> {
        rollouts::rollouts(&mut self.connection(), filter).await
    }

    async fn rollout(&self, id: RolloutId) -> Result<Option<Rollout>, StoreError> {
        rollouts::rollout(&mut self.connection(), id).await
    }

    async fn rollout_robots(&self, id: RolloutId) -> Result<Vec<Followed>, StoreError> {
        rollouts::robots(&mut self.connection(), id).await
    }

    async fn deployment_freeze(&self) -> Result<DeploymentFreeze, StoreError> {
        records::deployment_freeze(&mut self.connection()).await
    }

    async fn policy(&self) -> Result<StoredPolicy, StoreError> {
        policy::read(&mut self.connection()).await
    }

    async fn audit(&self, filter: &AuditFilter) -> Result<Vec<AuditRow>, StoreError> {
        records::audit_rows(&mut self.connection(), filter).await
    }

    async fn audit_after(&self, after: AuditId, limit: u32) -> Result<Vec<AuditRow>, StoreError> {
        records::audit_rows_after(&mut self.connection(), after, limit).await
    }

    async fn notes_after(
        &self,
        robot: &RobotId,
        after: AuditId,
        limit: u32,
    ) -> Result<Vec<AuditRow>, StoreError> {
        records::notes_after(&mut self.connection(), robot, after, limit).await
    }

    async fn audit_last(&self) -> Result<AuditId, StoreError> {
        query_scalar("SELECT coalesce(max(id), 0) FROM audit")
            .fetch_one(&mut self.connection())
            .await
            .map(AuditId)
            .map_err(StoreError::database("read the audit"))
    }

    async fn active_alerts(&self) -> Result<Vec<Alert>, StoreError> {
        alerts::active_alerts(&mut self.connection()).await
    }

    async fn alerts(&self, filter: &AlertFilter) -> Result<Vec<StoredAlert>, StoreError> {
        alerts::alerts(&mut self.connection(), filter).await
    }

    async fn alert(
        &self,
        id: AlertId,
    ) -> Result<Option<(StoredAlert, Vec<AlertMoment>)>, StoreError> {
        alerts::alert(&mut self.connection(), id).await
    }

    async fn webhooks(&self) -> Result<Vec<Webhook>, StoreError> {
        webhooks::webhooks(&mut self.connection()).await
    }

    async fn deliveries(
        &self,
        webhook: WebhookId,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<Delivery>, StoreError> {
        webhooks::deliveries(&mut self.connection(), webhook, before, limit).await
    }

    async fn due_deliveries(&self, now: WallTime) -> Result<Vec<DueDelivery>, StoreError> {
        webhooks::due(&mut self.connection(), now).await
    }

    async fn waiting_deliveries(&self) -> Result<u64, StoreError> {
        webhooks::waiting(&mut self.connection()).await
    }

    async fn close(&self) {
        self.pool.close().await;
    }
}

/// Returns the newest migration of the database.
///
/// # Errors
/// [`StoreError::Database`].
pub async fn schema_version(connection: &mut dyn Connection) -> Result<i64, StoreError> {
    query_scalar("SELECT coalesce(max(version), 0) FROM _sqlx_migrations WHERE success")
        .fetch_one(connection)
        .await
        .map_err(StoreError::database("read its schema's version"))
}

fn checkpoint_of(row: &Row) -> Result<CheckpointRecord, StoreError> {
    Ok(CheckpointRecord {
        robot: robot_id(row, "checkpoint", 0)?,
        stamp_ns: robot_time(row, "checkpoint", 1)?,
        received_ns: wall_time(row, "checkpoint", 2)?,
        state: column(row, "checkpoint", 3)?,
    })
}

fn stretch_of(row: &Row, tier: Tier, parameters: usize) -> Result<Stretch, StoreError> {
    let table = history::table(tier);
    let count: i64 = column(row, table, 1)?;
    let status: i64 = column(row, table, 2)?;
    let mut cells = Vec::with_capacity(parameters);
    for parameter in 0..parameters {
        let value = |offset: usize| column::<Option<f64>>(row, table, 4 + 4 * parameter + offset);
        let (mean, min, max, sigma) = (value(0)?, value(1)?, value(2)?, value(3)?);
        let cell = match (mean, min, max, sigma) {
            (Some(mean), Some(min), Some(max), Some(sigma)) => Some(Cell {
                mean,
                min,
                max,
                sigma,
            }),
            _ => None,
        };
        cells.push(cell);
    }
    Ok(Stretch {
        t_s: column(row, table, 0)?,
        count: u32::try_from(count).map_err(corrupt(table))?,
        status: PackedStatus::stored(status).map_err(corrupt(table))?,
        nis: column(row, table, 3)?,
        cells,
    })
}
