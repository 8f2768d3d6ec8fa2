//! Certificates: written in the transaction that verifies a deployment, and read.

use fleetcal_model::DeploymentId;
use fleetcal_store::{CertificateFilter, CertificateRecord, StoreError};

use super::connection::Connection;
use super::query::query;
use super::records::{number, record};
use super::row::{column, json, robot_id, wall_time};
use super::value::Row;

/// Reads certificates for [`certificate_of`].
const CERTIFICATES: &str =
    "SELECT number, robot, verified_ns, approved_by, record FROM certificate";

/// Writes a certificate.
pub(super) async fn save(
    connection: &mut dyn Connection,
    certificate: &CertificateRecord,
) -> Result<(), StoreError> {
    query(
        "INSERT INTO certificate (number, robot, verified_ns, approved_by, record)
         VALUES ($1, $2, $3, $4, $5)",
    )
    .bind(certificate.number.0 as i64)
    .bind(certificate.robot.as_str())
    .bind(certificate.verified_ns.0)
    .bind(&certificate.approved_by)
    .bind(json("certificate", &certificate.envelope)?)
    .execute(connection)
    .await
    .map_err(StoreError::database("write a certificate"))?;
    Ok(())
}

/// Returns certificates, newest first.
pub(super) async fn certificates(
    connection: &mut dyn Connection,
    filter: &CertificateFilter,
) -> Result<Vec<CertificateRecord>, StoreError> {
    let mut found = query(CERTIFICATES).push(" WHERE true");
    if let Some(robot) = &filter.robot {
        found = found.push(" AND robot = ").push_bind(robot.as_str());
    }
    if let Some(approved_by) = &filter.approved_by {
        found = found.push(" AND approved_by = ").push_bind(approved_by);
    }
    if let Some(from_ns) = filter.from_ns {
        found = found.push(" AND verified_ns >= ").push_bind(from_ns.0);
    }
    if let Some(to_ns) = filter.to_ns {
        found = found.push(" AND verified_ns < ").push_bind(to_ns.0);
    }
    if let Some(before) = filter.before {
        found = found.push(" AND number < ").push_bind(before);
    }
    let rows = found
        .push(" ORDER BY number DESC LIMIT ")
        .push_bind(i64::from(filter.limit))
        .fetch_all(connection)
        .await;
    rows.map_err(StoreError::database("read the certificates"))?
        .iter()
        .map(certificate_of)
        .collect()
}

/// Returns one certificate.
pub(super) async fn certificate(
    connection: &mut dyn Connection,
    id: DeploymentId,
) -> Result<Option<CertificateRecord>, StoreError> {
    let row = query(CERTIFICATES)
        .push(" WHERE number = $1")
        .bind(i64::try_from(id.0).unwrap_or(i64::MAX))
        .fetch_optional(connection)
        .await
        .map_err(StoreError::database("read a certificate"))?;
    row.as_ref().map(certificate_of).transpose()
}

fn certificate_of(row: &Row) -> Result<CertificateRecord, StoreError> {
    let table = "certificate";
    Ok(CertificateRecord {
        number: number(row, 0).map(DeploymentId)?,
        robot: robot_id(row, table, 1)?,
        verified_ns: wall_time(row, table, 2)?,
        approved_by: column(row, table, 3)?,
        envelope: record(row, table, 4)?,
    })
}
