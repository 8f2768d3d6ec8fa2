//! Roll-outs: their records, and their robots with the present states of their proposals.

use std::collections::BTreeMap;

use async_trait::async_trait;
use fleetcal_domain::approval::{Deployment, ProposalState};
use fleetcal_model::{ProposalId, RevisionId, RobotId, RolloutId};
use fleetcal_rollout::{Brought, Followed, Member, Rollout};
use fleetcal_store::transaction::RolloutRecords;
use fleetcal_store::{RolloutFilter, StoreError};

use super::connection::Connection;
use super::query::{query, query_scalar};
use super::records::{number, record};
use super::row::{column, corrupt, json, parsed, robot_id};
use super::transaction::SqlRecords;
use super::value::Row;

/// Robots that one statement writes.
const ROBOTS_AT_ONCE: usize = 100;
/// Name of the table in errors.
const TABLE: &str = "rollout";

#[async_trait]
impl RolloutRecords for SqlRecords<'_> {
    async fn next_rollout(&mut self) -> Result<RolloutId, StoreError> {
        let next: i64 = query_scalar("SELECT coalesce(max(id), 0) + 1 FROM rollout")
            .fetch_one(&mut *self.connection)
            .await
            .map_err(StoreError::database("read the next number"))?;
        Ok(RolloutId(next.unsigned_abs()))
    }

    async fn rollout(&mut self, id: RolloutId) -> Result<Option<Rollout>, StoreError> {
        rollout(self.connection, id).await
    }

    async fn save_rollout(&mut self, rollout: &Rollout) -> Result<(), StoreError> {
        query(
            "INSERT INTO rollout (id, record) VALUES ($1, $2)
             ON CONFLICT (id) DO UPDATE SET record = excluded.record",
        )
        .bind(rollout.id.0 as i64)
        .bind(json(TABLE, rollout)?)
        .execute(&mut *self.connection)
        .await
        .map_err(StoreError::database("write a roll-out"))?;
        Ok(())
    }

    async fn add_rollout_robots(
        &mut self,
        id: RolloutId,
        members: &[Member],
    ) -> Result<(), StoreError> {
        for members in members.chunks(ROBOTS_AT_ONCE) {
            let mut insert = query(
                "INSERT INTO rollout_robot (rollout, robot, wave, proposal, revision) VALUES ",
            );
            for (index, member) in members.iter().enumerate() {
                insert = insert
                    .push(if index == 0 { "(" } else { "), (" })
                    .push_bind(id.0 as i64)
                    .push(", ")
                    .push_bind(member.robot.as_str())
                    .push(", ")
                    .push_bind(member.wave)
                    .push(", ")
                    .push_bind(member.proposal.0 as i64)
                    .push(", ")
                    .push_bind(member.revision.0 as i64);
            }
            insert
                .push(")")
                .execute(&mut *self.connection)
                .await
                .map_err(StoreError::database("write the robots of a roll-out"))?;
        }
        Ok(())
    }

    async fn rollouts_beside(&mut self, id: RolloutId) -> Result<u32, StoreError> {
        let count: i64 = query_scalar(
            "SELECT count(*) FROM rollout WHERE state IN ('running', 'paused') AND id <> $1",
        )
        .bind(number_of(id))
        .fetch_one(&mut *self.connection)
        .await
        .map_err(StoreError::database("count the roll-outs"))?;
        Ok(u32::try_from(count).unwrap_or(u32::MAX))
    }

    async fn rollout_taken(
        &mut self,
        id: RolloutId,
    ) -> Result<Option<(RolloutId, RobotId)>, StoreError> {
        let row = query(
            "SELECT other.rollout, other.robot FROM rollout_robot AS own
             JOIN rollout_robot AS other
                 ON other.proposal = own.proposal AND other.rollout <> own.rollout
             JOIN rollout AS r ON r.id = other.rollout
             WHERE own.rollout = $1 AND r.state IN ('running', 'paused')
             ORDER BY other.rollout, other.proposal LIMIT 1",
        )
        .bind(number_of(id))
        .fetch_optional(&mut *self.connection)
        .await
        .map_err(StoreError::database("read the other roll-outs of robots"))?;
        let taken = |row: &Row| Ok((number(row, 0).map(RolloutId)?, robot_id(row, TABLE, 1)?));
        row.as_ref().map(taken).transpose()
    }

    async fn rollout_robots(&mut self, id: RolloutId) -> Result<Vec<Followed>, StoreError> {
        robots(self.connection, id).await
    }
}

/// Returns roll-outs, newest first.
pub(super) async fn rollouts(
    connection: &mut dyn Connection,
    filter: &RolloutFilter,
) -> Result<Vec<Rollout>, StoreError> {
    let mut found = query("SELECT record FROM rollout WHERE true");
    if let Some(state) = filter.state {
        found = found.push(" AND state = ").push_bind(state.as_str());
    }
    if let Some(before) = filter.before {
        found = found.push(" AND id < ").push_bind(before);
    }
    let rows = found
        .push(" ORDER BY id DESC LIMIT ")
        .push_bind(i64::from(filter.limit))
        .fetch_all(connection)
        .await;
    rows.map_err(StoreError::database("read the roll-outs"))?
        .iter()
        .map(|row| record(row, TABLE, 0))
        .collect()
}

/// Returns one roll-out.
pub(super) async fn rollout(
    connection: &mut dyn Connection,
    id: RolloutId,
) -> Result<Option<Rollout>, StoreError> {
    let row = query("SELECT record FROM rollout WHERE id = $1")
        .bind(number_of(id))
        .fetch_optional(connection)
        .await
        .map_err(StoreError::database("read a roll-out"))?;
    row.map(|row| record(&row, TABLE, 0)).transpose()
}

/// Returns the robots of a roll-out with the present states of their proposals, by wave and id.
pub(super) async fn robots(
    connection: &mut dyn Connection,
    id: RolloutId,
) -> Result<Vec<Followed>, StoreError> {
    let failed = || StoreError::database("read the robots of a roll-out");
    let returns = query(
        "SELECT record FROM deployment WHERE proposal IS NULL
         AND robot IN (SELECT robot FROM rollout_robot WHERE rollout = $1)",
    )
    .bind(number_of(id))
    .fetch_all(&mut *connection)
    .await
    .map_err(failed())?;
    let mut returns_of: BTreeMap<RobotId, Vec<Deployment>> = BTreeMap::new();
    for row in &returns {
        let one: Deployment = record(row, "deployment", 0)?;
        returns_of.entry(one.robot.clone()).or_default().push(one);
    }
    let rows = query(
        "SELECT m.robot, m.wave, m.proposal, m.revision, p.state, p.revision, d.record
         FROM rollout_robot AS m JOIN proposal AS p ON p.id = m.proposal
         LEFT JOIN deployment AS d ON d.proposal = m.proposal
         WHERE m.rollout = $1 ORDER BY m.wave, m.robot",
    )
    .bind(number_of(id))
    .fetch_all(connection)
    .await
    .map_err(failed())?;
    rows.iter().map(|row| followed(row, &returns_of)).collect()
}

fn followed(
    row: &Row,
    returns_of: &BTreeMap<RobotId, Vec<Deployment>>,
) -> Result<Followed, StoreError> {
    let robot = robot_id(row, TABLE, 0)?;
    let returns = returns_of.get(&robot).map_or(&[][..], Vec::as_slice);
    let state: String = column(row, TABLE, 4)?;
    let unknown = || corrupt(TABLE)(format!("{state} is no state of a proposal"));
    let deployment: Option<String> = column(row, TABLE, 6)?;
    let deployment: Option<Deployment> = deployment
        .map(|json| parsed("deployment", &json))
        .transpose()?;
    Ok(Followed {
        member: Member {
            robot,
            wave: column(row, TABLE, 1)?,
            proposal: number(row, 2).map(ProposalId)?,
            revision: number(row, 3).map(RevisionId)?,
        },
        proposal_state: ProposalState::parse(&state).ok_or_else(unknown)?,
        proposal_revision: number(row, 5).map(RevisionId)?,
        brought: deployment.map(|deployment| Brought::of(&deployment, returns)),
    })
}

fn number_of(id: RolloutId) -> i64 {
    i64::try_from(id.0).unwrap_or(i64::MAX)
}
