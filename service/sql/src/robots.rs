//! Robots' configurations.

use async_trait::async_trait;
use fleetcal_domain::robot::RobotConfig;
use fleetcal_model::{EventId, RobotId, Version, WallTime};
use fleetcal_store::transaction::RobotRecords;
use fleetcal_store::{EventRecord, NewEvent, RobotRecord, StoreError};

use super::events;
use super::query::{query, query_scalar};
use super::row::{column, corrupt, json, parsed, robot_id, wall_time};
use super::transaction::SqlRecords;
use super::value::Row;

/// Reads every robot for [`robot_of`].
pub(super) const SELECT_ALL: &str =
    "SELECT id, config, version, created_ns, updated_ns, drawn_by FROM robot ORDER BY id";

/// Reads one robot.
pub(super) const SELECT_ONE: &str =
    "SELECT id, config, version, created_ns, updated_ns, drawn_by FROM robot WHERE id = $1";

#[async_trait]
impl RobotRecords for SqlRecords<'_> {
    async fn robot(&mut self, id: &RobotId) -> Result<Option<RobotRecord>, StoreError> {
        let row = query(SELECT_ONE)
            .bind(id.as_str())
            .fetch_optional(&mut *self.connection)
            .await
            .map_err(StoreError::database("read a robot"))?;
        row.as_ref().map(robot_of).transpose()
    }

    async fn count_configured(&mut self) -> Result<u32, StoreError> {
        query_scalar("SELECT count(*) FROM robot WHERE config IS NOT NULL")
            .fetch_one(&mut *self.connection)
            .await
            .map_err(StoreError::database("count the robots"))
    }

    async fn save_config(
        &mut self,
        id: &RobotId,
        config: &RobotConfig,
        drawn_by: Option<&str>,
        version: Version,
        now: WallTime,
    ) -> Result<(), StoreError> {
        let key = self.key_of(id, now).await?;
        let set = "UPDATE robot SET config = $2, version = $3, updated_ns = $4, drawn_by = $5
             WHERE key = $1";
        query(set)
            .bind(key)
            .bind(json("robot", config)?)
            .bind(version.0 as i64)
            .bind(now.0)
            .bind(drawn_by)
            .execute(&mut *self.connection)
            .await
            .map_err(StoreError::database("write a robot's configuration"))?;
        Ok(())
    }

    async fn event(&mut self, id: EventId) -> Result<Option<EventRecord>, StoreError> {
        events::by_number(self.connection, id).await
    }

    async fn add_event(&mut self, event: &NewEvent) -> Result<EventId, StoreError> {
        let key = self.key_of(&event.robot, event.received_ns).await?;
        events::add(self.connection, key, event).await.map(EventId)
    }
}

/// Reads a robot from `id, config, version, created_ns, updated_ns, drawn_by`.
pub(super) fn robot_of(row: &Row) -> Result<RobotRecord, StoreError> {
    let config: Option<String> = column(row, "robot", 1)?;
    let version: i64 = column(row, "robot", 2)?;
    Ok(RobotRecord {
        id: robot_id(row, "robot", 0)?,
        config: config.map(|config| parsed("robot", &config)).transpose()?,
        version: Version(u64::try_from(version).map_err(corrupt("robot"))?),
        created_ns: wall_time(row, "robot", 3)?,
        updated_ns: wall_time(row, "robot", 4)?,
        drawn_by: column(row, "robot", 5)?,
    })
}
