//! `GET /audit`: who did what.

use axum::Json;
use axum::extract::State;
use axum::response::{IntoResponse, Response};
use fleetcal_domain::limits;
use fleetcal_http::csv::{CSV, file, line};
use fleetcal_model::{AuditId, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_store::{AuditFilter, AuditRow};
use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use super::proposals::robot_named;
use crate::ApiState;
use crate::extract::{Parameters, number_of, number_within, time as time_of};
use crate::page::{cut, with_next};
use crate::problem::Problem;
use crate::time;

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct AuditParameters {
    /// Only about this robot.
    #[param(value_type = Option<RobotId>)]
    robot: Option<String>,
    /// Only by this person, token, robot, or `fleetcal` itself.
    actor: Option<String>,
    /// Only actions that begin so, such as `proposal.` or `deployment.roll_back`.
    action: Option<String>,
    /// From this time on.
    #[param(value_type = Option<String>, format = DateTime)]
    from: Option<String>,
    /// Before this time.
    #[param(value_type = Option<String>, format = DateTime)]
    to: Option<String>,
    /// `json` (a page), `csv` or `ndjson` (to be saved); a page unless given.
    format: Option<String>,
    /// Rows of a page, 1 to 1000; of a file, 1 to 100000.
    #[param(value_type = Option<u32>)]
    limit: Option<String>,
    /// `next` of the page before.
    cursor: Option<String>,
}

/// A row of the audit.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = AuditRow)]
struct AuditDocument {
    id: AuditId,
    #[schema(value_type = String, format = DateTime)]
    time: Timestamp,
    /// Who: a person's or token's name, a robot's id, or `fleetcal` itself.
    actor: String,
    /// How that is known.
    authentication: String,
    role: Option<String>,
    /// The HTTP request's id.
    request: Option<String>,
    /// The address that the HTTP request came from.
    address: Option<String>,
    /// What was done.
    action: String,
    /// To what kind of record.
    subject: String,
    /// To which one.
    subject_id: String,
    robot: Option<String>,
    /// Why.
    reason: Option<String>,
    /// The record before.
    #[schema(value_type = Option<Object>)]
    before: Option<serde_json::Value>,
    /// The record after.
    #[schema(value_type = Option<Object>)]
    after: Option<serde_json::Value>,
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
        }
    }
}

/// A page of the audit, newest first.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct AuditPage {
    items: Vec<AuditDocument>,
    /// `cursor` of the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    next: Option<String>,
}

#[derive(Clone, Copy, PartialEq)]
enum Format {
    Page,
    Csv,
    Ndjson,
}

/// Lists who did what, newest first: every change of a proposal, deployment, shadow, user, token
/// and of the deployment freeze, with the record before and after.
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
    )
)]
pub(super) async fn list_audit(
    State(api): State<ApiState>,
    Parameters(query): Parameters<AuditParameters>,
) -> Result<Response, Problem> {
    let format = match query.format.as_deref() {
        None | Some("json") => Format::Page,
        Some("csv") => Format::Csv,
        Some("ndjson") => Format::Ndjson,
        Some(other) => return Err(Problem::refused("format", other, "json, csv or ndjson")),
    };
    let (most, default) = match format {
        Format::Page => (limits::HTTP_PAGE_MAX, limits::HTTP_PAGE_DEFAULT),
        Format::Csv | Format::Ndjson => (limits::AUDIT_FILE_ROWS_MAX, limits::AUDIT_FILE_ROWS_MAX),
    };
    let limit = number_within("limit", query.limit.as_deref(), 1..=most, default)?;
    let filter = filter_of(&query, with_next(limit))?;
    let mut rows = api.store.audit(&filter).await?;
    let next = cut(&mut rows, limit, |last| last.id.to_string());
    let items: Vec<_> = rows.into_iter().map(AuditDocument::of).collect();
    Ok(match format {
        Format::Page => Json(AuditPage { items, next }).into_response(),
        Format::Csv => file(CSV, "audit.csv", csv(&items)),
        Format::Ndjson => file("application/x-ndjson", "audit.ndjson", ndjson(&items)),
    })
}

fn filter_of(query: &AuditParameters, limit: u32) -> Result<AuditFilter, Problem> {
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
        before: query.cursor.as_deref().map(number_of).transpose()?,
        limit,
    })
}

fn ndjson(items: &[AuditDocument]) -> String {
    let lines = items
        .iter()
        .filter_map(|item| serde_json::to_string(item).ok());
    lines.map(|line| line + "\n").collect()
}

fn csv(items: &[AuditDocument]) -> String {
    let mut text = String::from(
        "id,time,actor,authentication,role,request,action,subject,subject_id,robot,reason,\
         before,after,address\r\n",
    );
    for item in items {
        let empty = String::new;
        let json = |value: &Option<serde_json::Value>| {
            value.as_ref().map_or_else(String::new, ToString::to_string)
        };
        let fields = [
            item.id.to_string(),
            item.time.to_string(),
            item.actor.clone(),
            item.authentication.clone(),
            item.role.clone().unwrap_or_else(empty),
            item.request.clone().unwrap_or_else(empty),
            item.action.clone(),
            item.subject.clone(),
            item.subject_id.clone(),
            item.robot.clone().unwrap_or_else(empty),
            item.reason.clone().unwrap_or_else(empty),
            json(&item.before),
            json(&item.after),
            item.address.clone().unwrap_or_else(empty),
        ];
        text.push_str(&line(fields.iter().map(String::as_str)));
    }
    text
}
