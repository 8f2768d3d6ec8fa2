//! Routes of the audit: the record of all changes, and its signed head.

use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::Response;
use fleetcal_domain::limits;
use fleetcal_http::csv::{self, CSV};
use fleetcal_model::{AuditId, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::audit_head::{AuditHeadDocument, AuditHeadSchema};
use fleetcal_proto::calibration::Envelope;
use fleetcal_store::{AuditFilter, AuditRow};
use futures::FutureExt;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use super::proposals::robot_named;
use crate::ApiState;
use crate::access::Caller;
use crate::export::Export;
use crate::extract::{NoParameters, Parameters, number_of, number_within, time as time_of};
use crate::listing::{self, Layout, Rows};
use crate::page::page_limit;
use crate::problem::Problem;
use crate::time;

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct AuditParameters {
    /// Robot of the rows.
    #[param(value_type = Option<RobotId>)]
    robot: Option<String>,
    /// Actor of the rows: a person, token, robot, or `fleetcal` itself.
    actor: Option<String>,
    /// Prefix of the rows' actions, such as `proposal.` or `deployment.roll_back`.
    action: Option<String>,
    /// Earliest time of a row.
    #[param(value_type = Option<String>, format = DateTime)]
    from: Option<String>,
    /// Time that the rows come before.
    #[param(value_type = Option<String>, format = DateTime)]
    to: Option<String>,
    /// Format: `json` (a page), `csv` or `ndjson` (to be saved); a page unless given.
    format: Option<String>,
    /// Rows of a page, 1 to 1000; of a file, 1 to 100000.
    #[param(value_type = Option<u32>)]
    limit: Option<String>,
    /// Value of `next` of the previous page.
    cursor: Option<String>,
}

/// Row of the audit.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = AuditRow)]
struct AuditDocument {
    id: AuditId,
    #[schema(value_type = String, format = DateTime)]
    time: Timestamp,
    /// Name of the actor: a person's or token's name, a robot's id, or `fleetcal` itself.
    actor: String,
    /// Proof of the actor's identity.
    authentication: String,
    role: Option<String>,
    /// Id of the HTTP request.
    request: Option<String>,
    /// Client address of the HTTP request.
    address: Option<String>,
    /// Action on the record.
    action: String,
    /// Kind of the record.
    subject: String,
    /// Number or name of the record.
    subject_id: String,
    robot: Option<String>,
    /// Reason for the action.
    reason: Option<String>,
    /// Record before the action.
    #[schema(value_type = Option<Object>)]
    before: Option<serde_json::Value>,
    /// Record after the action.
    #[schema(value_type = Option<Object>)]
    after: Option<serde_json::Value>,
    /// Link of the row: lower-case hexadecimal SHA-256 over the link of the row before, a line feed,
    /// and the row; `fleetcal audit` checks it. Absent for rows of versions without links.
    #[serde(skip_serializing_if = "Option::is_none")]
    link: Option<String>,
}

impl AuditDocument {
    fn of(row: AuditRow) -> Self {
        Self {
            id: row.id,
            time: time::of(row.at_ns),
            actor: row.actor,
            authentication: row.authentication,
            role: row.role,
            request: row.request,
            address: row.address,
            action: row.action,
            subject: row.subject,
            subject_id: row.subject_id,
            robot: row.robot,
            reason: row.reason,
            before: row.before,
            after: row.after,
            link: row.link,
        }
    }
}

/// A page of the audit, newest first.
#[derive(Serialize, utoipa::ToSchema)]
pub(super) struct AuditPage {
    items: Vec<AuditDocument>,
    /// Value of `cursor` for the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    next: Option<String>,
}

/// Layout of the audit's rows.
type AuditLayout = Layout<AuditDocument>;

const CSV_LAYOUT: AuditLayout = Layout::Csv {
    head: "id,time,actor,authentication,role,request,action,subject,subject_id,robot,reason,\
           before,after,address,link\r\n",
    line: csv_line,
};

/// Lists the audit, newest first: every change of a proposal, deployment, shadow, user, token and
/// of the deployment freeze, with the record before and after.
///
/// A file is sent while it is read; if reading fails, the connection is closed before its end.
#[utoipa::path(
    get,
    path = "/audit",
    tag = "approval",
    params(AuditParameters),
    responses(
        (status = OK, description = "A page of audit records; with `format` a file of them",
            content(
                (AuditPage = "application/json"),
                (String = "text/csv"),
                (String = "application/x-ndjson"),
            )),
        (status = TOO_MANY_REQUESTS,
            description = "Too many files are written for the user or token"),
        (status = SERVICE_UNAVAILABLE,
            description = "Too many files are written, or the database is unavailable"),
    )
)]
pub(super) async fn list_audit(
    State(api): State<ApiState>,
    Parameters(query): Parameters<AuditParameters>,
    caller: Caller,
) -> Result<Response, Problem> {
    let file: Option<(AuditLayout, _, _)> = match query.format.as_deref() {
        None | Some("json") => None,
        Some("csv") => Some((CSV_LAYOUT, CSV, "audit.csv")),
        Some("ndjson") => Some((Layout::Ndjson, "application/x-ndjson", "audit.ndjson")),
        Some(other) => return Err(Problem::refused("format", other, "json, csv or ndjson")),
    };
    let Some((layout, kind, name)) = file else {
        let limit = page_limit(query.limit.as_deref())?;
        return listing::page(rows(&api, &query, limit)?).await;
    };
    let most = limits::AUDIT_FILE_ROWS_MAX;
    let limit = number_within("limit", query.limit.as_deref(), 1..=most, most)?;
    let rows = rows(&api, &query, limit)?;
    let export = Export::begin(&api, caller)?;
    let pieces = listing::text(rows, layout).await?;
    Ok(csv::file(kind, name, export.body(pieces)))
}

/// Returns the last row of the audit, signed. Kept elsewhere, it shows later whether a row up to it
/// was changed or removed: `fleetcal audit verify --head`.
#[utoipa::path(
    get,
    path = "/audit/head",
    tag = "approval",
    responses(
        (status = OK,
            description = "The head; the content of `document` is an `AuditHeadDocument`",
            body = Envelope),
        (status = NOT_FOUND, description = "No row has a link yet"),
    )
)]
pub(super) async fn get_audit_head(
    State(api): State<ApiState>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Result<Json<Envelope>, Problem> {
    let newest = AuditFilter {
        limit: 1,
        ..AuditFilter::default()
    };
    let last = api.store.audit(&newest).await?.pop();
    let (row, link) = last
        .and_then(|row| Some((row.id, row.link?)))
        .ok_or_else(|| {
            let detail = "no row of the audit has a link yet: nothing was changed since the service \
                          writes them";
            Problem::new(StatusCode::NOT_FOUND, "audit_head_unknown", detail.to_owned())
        })?;
    let head = AuditHeadDocument {
        schema: AuditHeadSchema::V1,
        row,
        link,
        signed: time::of(api.clock.now()).to_string(),
    };
    let signed = api.lifecycle.sign(&head);
    signed.map(Json).map_err(|refused| {
        Problem::new(
            StatusCode::INTERNAL_SERVER_ERROR,
            "audit_head_unsigned",
            refused.to_string(),
        )
    })
}

/// Requested rows.
fn rows(
    api: &ApiState,
    query: &AuditParameters,
    limit: u32,
) -> Result<Rows<AuditDocument>, Problem> {
    let after = query.cursor.as_deref().map(number_of).transpose()?;
    let filter = filter_of(query)?;
    let store = api.store.clone();
    let read = move |before, limit| {
        let (store, mut filter) = (store.clone(), filter.clone());
        (filter.before, filter.limit) = (before, limit);
        let documents = async move {
            let rows = store.audit(&filter).await?;
            let numbered = |row: AuditRow| (row.id.0, AuditDocument::of(row));
            Ok(rows.into_iter().map(numbered).collect())
        };
        documents.boxed()
    };
    Ok(Rows::new(after, limit, read))
}

fn filter_of(query: &AuditParameters) -> Result<AuditFilter, Problem> {
    let wall = |field, given: Option<&str>| -> Result<Option<WallTime>, Problem> {
        let time = time_of(field, given)?;
        Ok(time.map(|time| time::wall(time).unwrap_or(WallTime::MAX)))
    };
    Ok(AuditFilter {
        robot: query.robot.as_deref().map(robot_named).transpose()?,
        actor: query.actor.clone(),
        action: query.action.clone(),
        from_ns: wall("from", query.from.as_deref())?,
        to_ns: wall("to", query.to.as_deref())?,
        ..AuditFilter::default()
    })
}

fn csv_line(item: &AuditDocument) -> String {
    let json = |value: &Option<serde_json::Value>| {
        value.as_ref().map_or_else(String::new, ToString::to_string)
    };
    let (id, time) = (item.id.to_string(), item.time.to_string());
    let (before, after) = (json(&item.before), json(&item.after));
    let or_empty = |text: &'_ Option<String>| text.clone().unwrap_or_default();
    csv::line([
        &*id,
        &time,
        &item.actor,
        &item.authentication,
        &or_empty(&item.role),
        &or_empty(&item.request),
        &item.action,
        &item.subject,
        &item.subject_id,
        &or_empty(&item.robot),
        &or_empty(&item.reason),
        &before,
        &after,
        &or_empty(&item.address),
        &or_empty(&item.link),
    ])
}
