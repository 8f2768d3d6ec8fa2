//! The connections that only read.

use std::collections::BTreeMap;

use async_trait::async_trait;
use fleetcal_domain::alert::Alert;
use fleetcal_domain::approval::{
    Deployment, DeploymentState, OutboxEntry, Proposal, Revision, RobotLedger,
};
use fleetcal_domain::webhook::{Delivery, Webhook};
use fleetcal_model::{AlertId, Generation, Parameter, ProposalId, WallTime, WebhookId};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::Envelope;
use fleetcal_store::backend::{Cell, Reader, Stretch, Tier};
use fleetcal_store::{
    AlertFilter, AlertMoment, AuditFilter, AuditRow, CheckpointRecord, CrossTrackRecord,
    CurrentRecord, DeploymentFreeze, DueDelivery, EventRecord, ProposalFilter, RobotRecord,
    StoreError, StoredPolicy,
};
use sqlx::AssertSqlSafe;
use sqlx::sqlite::{SqlitePool, SqliteRow};

use super::row::{column, corrupt, parsed, robot_id, robot_time, wall_time};
use super::{alerts, columns, events, policy, records, robots, webhooks};

/// The pool of connections that only read.
#[derive(Debug)]
pub(crate) struct SqliteReader {
    pool: SqlitePool,
}

impl SqliteReader {
    pub(super) fn new(pool: SqlitePool) -> Self {
        Self { pool }
    }

    pub(super) fn pool(&self) -> &SqlitePool {
        &self.pool
    }
}

#[async_trait]
impl Reader for SqliteReader {
    async fn robots(&self) -> Result<Vec<RobotRecord>, StoreError> {
        let rows = sqlx::query(robots::SELECT_ALL)
            .fetch_all(&self.pool)
            .await
            .map_err(StoreError::database("read the robots"))?;
        rows.iter().map(robots::robot_of).collect()
    }

    async fn robot(&self, id: &RobotId) -> Result<Option<RobotRecord>, StoreError> {
        let row = sqlx::query(robots::SELECT_ONE)
            .bind(id.as_str())
            .fetch_optional(&self.pool)
            .await
            .map_err(StoreError::database("read a robot"))?;
        row.as_ref().map(robots::robot_of).transpose()
    }

    async fn current(&self) -> Result<Vec<CurrentRecord>, StoreError> {
        let rows = sqlx::query("SELECT received_ns, estimate FROM robot_current ORDER BY robot")
            .fetch_all(&self.pool)
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
        let rows = sqlx::query(
            "SELECT r.id, c.stamp_ns, c.received_ns, c.state
             FROM checkpoint AS c JOIN robot AS r ON r.key = c.robot ORDER BY r.id",
        )
        .fetch_all(&self.pool)
        .await
        .map_err(StoreError::database("read the estimators' states"))?;
        rows.iter()
            .map(|row| {
                Ok(CheckpointRecord {
                    robot: robot_id(row, "checkpoint", 0)?,
                    stamp_ns: robot_time(row, "checkpoint", 1)?,
                    received_ns: wall_time(row, "checkpoint", 2)?,
                    state: column(row, "checkpoint", 3)?,
                })
            })
            .collect()
    }

    async fn cross_tracks(&self) -> Result<Vec<CrossTrackRecord>, StoreError> {
        let rows = sqlx::query("SELECT robot, generation, errors FROM cross_track")
            .fetch_all(&self.pool)
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
        // Two statements in one, because only a lone `min` or `max` is taken from the key.
        let table = columns::table(tier);
        let sql = format!("SELECT (SELECT min(t) FROM {table}), (SELECT max(t) FROM {table})");
        let row = sqlx::query(AssertSqlSafe(sql))
            .fetch_one(&self.pool)
            .await
            .map_err(StoreError::database("read the extent of the history"))?;
        let first: Option<i64> = column(&row, table, 0)?;
        let last: Option<i64> = column(&row, table, 1)?;
        Ok(first.zip(last))
    }

    async fn last_second(&self, id: &RobotId) -> Result<Option<i64>, StoreError> {
        let failed = || StoreError::database("read the latest estimate");
        let stamp_ns: Option<i64> = sqlx::query_scalar(
            "SELECT stamp_ns FROM robot_current
             WHERE robot = (SELECT key FROM robot WHERE id = ?1)",
        )
        .bind(id.as_str())
        .fetch_optional(&self.pool)
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
        let key: Option<i64> = sqlx::query_scalar("SELECT key FROM robot WHERE id = ?1")
            .bind(id.as_str())
            .fetch_optional(&self.pool)
            .await
            .map_err(failed())?;
        let Some(key) = key else {
            return Ok(Vec::new());
        };
        // The text is made of table and column names of this program alone.
        let rows = sqlx::query(AssertSqlSafe(columns::select(tier, parameters)))
            .bind(from_s)
            .bind(to_s)
            .bind(tier.seconds())
            .bind(key)
            .fetch_all(&self.pool)
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
        let rows = sqlx::query(
            "SELECT e.id, r.id, e.kind, e.stamp_ns, e.received_ns, e.source, e.author, e.note,
                 e.details
             FROM robot_event AS e JOIN robot AS r ON r.key = e.robot
             WHERE r.id = ?1 AND e.id < ?2 ORDER BY e.id DESC LIMIT ?3",
        )
        .bind(id.as_str())
        .bind(before.unwrap_or(i64::MAX))
        .bind(limit)
        .fetch_all(&self.pool)
        .await
        .map_err(StoreError::database("read a robot's events"))?;
        rows.iter()
            .map(|row| events::event_of(row, false))
            .collect()
    }

    async fn schema_version(&self) -> Result<i64, StoreError> {
        sqlx::query_scalar("SELECT max(version) FROM _sqlx_migrations WHERE success")
            .fetch_one(&self.pool)
            .await
            .map_err(StoreError::database("read its schema's version"))
    }

    async fn ledgers(&self) -> Result<Vec<RobotLedger>, StoreError> {
        records::ledgers(&self.pool).await
    }

    async fn envelope(
        &self,
        robot: &RobotId,
        generation: Generation,
    ) -> Result<Option<Envelope>, StoreError> {
        records::envelope(&self.pool, robot, generation).await
    }

    async fn outbox(&self) -> Result<Vec<(RobotId, OutboxEntry)>, StoreError> {
        records::outbox(&self.pool).await
    }

    async fn proposals(
        &self,
        filter: &ProposalFilter,
    ) -> Result<Vec<(Proposal, Revision)>, StoreError> {
        records::proposals(&self.pool, filter).await
    }

    async fn proposal(&self, id: ProposalId) -> Result<Option<(Proposal, Revision)>, StoreError> {
        records::proposal(&self.pool, id).await
    }

    async fn deployments(
        &self,
        robot: &RobotId,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<Deployment>, StoreError> {
        records::deployments(&self.pool, robot, before, limit).await
    }

    async fn followed(
        &self,
        proposals: &[ProposalId],
    ) -> Result<BTreeMap<ProposalId, DeploymentState>, StoreError> {
        records::followed(&self.pool, proposals).await
    }

    async fn deployment_freeze(&self) -> Result<DeploymentFreeze, StoreError> {
        records::deployment_freeze(&self.pool).await
    }

    async fn policy(&self) -> Result<StoredPolicy, StoreError> {
        policy::read(&self.pool).await
    }

    async fn audit(&self, filter: &AuditFilter) -> Result<Vec<AuditRow>, StoreError> {
        records::audit_rows(&self.pool, filter).await
    }

    async fn active_alerts(&self) -> Result<Vec<Alert>, StoreError> {
        alerts::active_alerts(&self.pool).await
    }

    async fn alerts(&self, filter: &AlertFilter) -> Result<Vec<Alert>, StoreError> {
        alerts::alerts(&self.pool, filter).await
    }

    async fn alert(&self, id: AlertId) -> Result<Option<(Alert, Vec<AlertMoment>)>, StoreError> {
        alerts::alert(&self.pool, id).await
    }

    async fn webhooks(&self) -> Result<Vec<Webhook>, StoreError> {
        webhooks::webhooks(&self.pool).await
    }

    async fn deliveries(
        &self,
        webhook: WebhookId,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<Delivery>, StoreError> {
        webhooks::deliveries(&self.pool, webhook, before, limit).await
    }

    async fn due_deliveries(&self, now: WallTime) -> Result<Vec<DueDelivery>, StoreError> {
        webhooks::due(&self.pool, now).await
    }

    async fn waiting_deliveries(&self) -> Result<u64, StoreError> {
        webhooks::waiting(&self.pool).await
    }

    async fn close(&self) {
        self.pool.close().await;
    }
}

fn stretch_of(row: &SqliteRow, tier: Tier, parameters: usize) -> Result<Stretch, StoreError> {
    let table = columns::table(tier);
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
        status: u32::try_from(status).map_err(corrupt(table))?,
        nis: column(row, table, 3)?,
        cells,
    })
}
