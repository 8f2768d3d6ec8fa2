//! Route `GET /certificates`: certificates as a page, or all of them as a file.

use axum::extract::State;
use axum::response::Response;
use fleetcal_domain::limits;
use fleetcal_http::csv;
use fleetcal_model::{DeploymentId, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::Envelope;
use fleetcal_store::{CertificateFilter, CertificateRecord};
use futures::FutureExt;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use crate::ApiState;
use crate::access::Caller;
use crate::approval::robot_named;
use crate::export::Export;
use crate::extract::{Parameters, number_of, number_within, time as time_of};
use crate::listing::{self, Layout, Rows, number};
use crate::page::page_limit;
use crate::problem::Problem;
use crate::time;

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct CertificateParameters {
    /// Robot of the certificates.
    #[param(value_type = Option<RobotId>)]
    robot: Option<String>,
    /// Approvers of the certificates, as `approved_by` names them.
    approved_by: Option<String>,
    /// Earliest time of a verification.
    #[param(value_type = Option<String>, format = DateTime)]
    from: Option<String>,
    /// Time that the verifications come before.
    #[param(value_type = Option<String>, format = DateTime)]
    to: Option<String>,
    /// Format: `json` (a page of summaries) or `ndjson` (a file of certificates, one in each line);
    /// a page unless given.
    format: Option<String>,
    /// Certificates of a page, 1 to 1000; of a file, 1 to 100000.
    #[param(value_type = Option<u32>)]
    limit: Option<String>,
    /// Value of `next` of the previous page.
    cursor: Option<String>,
}

/// Summary of a certificate.
#[derive(Debug, Serialize, utoipa::ToSchema)]
struct CertificateSummary {
    /// Number of the certificate: that of the deployment which was verified.
    number: DeploymentId,
    robot: RobotId,
    /// Time of the verification.
    #[schema(value_type = String, format = DateTime)]
    verified: Timestamp,
    /// Approvers of the calibration, separated by commas.
    approved_by: String,
    /// SHA-256 of the signed document, lower-case hexadecimal.
    sha256: String,
    /// Id of the key that signed it.
    key_id: String,
}

impl CertificateSummary {
    fn of(record: CertificateRecord) -> Self {
        Self {
            number: record.number,
            robot: record.robot,
            verified: time::of(record.verified_ns),
            approved_by: record.approved_by,
            sha256: record.envelope.sha256,
            key_id: record.envelope.key_id,
        }
    }
}

/// A page of certificates, newest first.
#[derive(Serialize, utoipa::ToSchema)]
pub(super) struct CertificatePage {
    items: Vec<CertificateSummary>,
    /// Value of `cursor` for the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    next: Option<String>,
}

/// Lists the certificates of verified calibrations, newest first.
///
/// Each line of a file is a certificate as `GET /certificates/{id}` returns it, for
/// `fleetcal verify`. A file is sent while it is read; if reading fails, the connection is closed
/// before its end.
#[utoipa::path(
    get,
    path = "/certificates",
    tag = "approval",
    params(CertificateParameters),
    responses(
        (status = OK, description = "A page of certificates; with `format` a file of them",
            content(
                (CertificatePage = "application/json"),
                (String = "application/x-ndjson"),
            )),
        (status = TOO_MANY_REQUESTS,
            description = "Too many files are written for the user or token"),
        (status = SERVICE_UNAVAILABLE,
            description = "Too many files are written, or the database is unavailable"),
    )
)]
pub(super) async fn list_certificates(
    State(api): State<ApiState>,
    Parameters(query): Parameters<CertificateParameters>,
    caller: Caller,
) -> Result<Response, Problem> {
    match query.format.as_deref() {
        None | Some("json") => {
            let limit = page_limit(query.limit.as_deref())?;
            listing::page(rows(&api, &query, limit, CertificateSummary::of)?).await
        }
        Some("ndjson") => {
            let most = limits::CERTIFICATE_FILE_ROWS_MAX;
            let limit = number_within("limit", query.limit.as_deref(), 1..=most, most)?;
            let envelope = |record: CertificateRecord| -> Envelope { record.envelope };
            let rows = rows(&api, &query, limit, envelope)?;
            let export = Export::begin(&api, caller)?;
            let pieces = listing::text(rows, Layout::Ndjson).await?;
            let name = "certificates.ndjson";
            Ok(csv::file("application/x-ndjson", name, export.body(pieces)))
        }
        Some(other) => Err(Problem::refused("format", other, "json or ndjson")),
    }
}

/// Requested certificates, each in the form that `shown` gives it.
fn rows<Row: 'static>(
    api: &ApiState,
    query: &CertificateParameters,
    limit: u32,
    shown: fn(CertificateRecord) -> Row,
) -> Result<Rows<Row>, Problem> {
    let before = query.cursor.as_deref().map(number_of).transpose()?;
    let filter = filter_of(query)?;
    let store = api.store.clone();
    let read = move |before, limit| {
        let (store, mut filter) = (store.clone(), filter.clone());
        (filter.before, filter.limit) = (before, limit);
        let documents = async move {
            let found = store.certificates(&filter).await?;
            let numbered = |one: CertificateRecord| (number(one.number.0), shown(one));
            Ok(found.into_iter().map(numbered).collect())
        };
        documents.boxed()
    };
    Ok(Rows::new(before, limit, read))
}

fn filter_of(query: &CertificateParameters) -> Result<CertificateFilter, Problem> {
    let wall = |field, given: Option<&str>| -> Result<Option<WallTime>, Problem> {
        let time = time_of(field, given)?;
        Ok(time.map(|time| time::wall(time).unwrap_or(WallTime::MAX)))
    };
    Ok(CertificateFilter {
        robot: query.robot.as_deref().map(robot_named).transpose()?,
        approved_by: query.approved_by.clone(),
        from_ns: wall("from", query.from.as_deref())?,
        to_ns: wall("to", query.to.as_deref())?,
        ..CertificateFilter::default()
    })
}
