//! Routes `GET` and `POST /robots/{id}/events`: a robot's history of events.

use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use fleetcal_domain::limits;
use fleetcal_domain::robot::{HistoryEvent, RobotView};
use fleetcal_fleet::live::LiveUpdate;
use fleetcal_model::{NoteKind, RobotTime, WallTime};
use fleetcal_operations::{notes, robots};
use fleetcal_proto::RobotId;
use fleetcal_proto::event::RobotEvent;
use fleetcal_store::{EventKind, EventRecord, EventSource, NewEvent, kind_of_note};
use futures::FutureExt;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use crate::ApiState;
use crate::access::Caller;
use crate::extract::{
    Body, NoParameters, Parameters, RobotPath, check_length, idempotency_key, number_of,
};
use crate::listing::{self, Rows};
use crate::page::page_limit;
use crate::problem::Problem;
use crate::time;

/// Event of a robot.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Event)]
pub(crate) struct EventDocument {
    /// Number of the event; later events have higher ones. Absent on the event stream.
    #[serde(skip_serializing_if = "Option::is_none")]
    id: Option<i64>,
    robot: RobotId,
    kind: EventKind,
    /// Time of the event, by the robot's clock.
    #[schema(value_type = String, format = DateTime)]
    time: Timestamp,
    /// Time at which the service received it, by its own clock.
    #[schema(value_type = String, format = DateTime)]
    received: Timestamp,
    /// Source of the event.
    source: EventSource,
    /// Name of the person or tool.
    author: Option<String>,
    /// Note, in words.
    note: Option<String>,
    /// Details that belong to its kind: for a change `cause`, `time_s`, `onset_s` and `change`.
    #[schema(value_type = Option<Object>)]
    details: Option<serde_json::Value>,
}

impl EventDocument {
    /// Document of an event without a number yet.
    pub(crate) fn of(event: NewEvent) -> Self {
        Self {
            id: None,
            robot: event.robot,
            kind: event.kind,
            time: time::of_robot(event.stamp_ns),
            received: time::of(event.received_ns),
            source: event.source,
            author: event.author,
            note: event.note,
            details: event.details,
        }
    }

    fn of_record(record: EventRecord) -> Self {
        Self {
            id: Some(record.id.0),
            ..Self::of(record.event)
        }
    }
}

/// A page of events, newest first.
#[derive(Serialize, utoipa::ToSchema)]
pub(super) struct EventPage {
    items: Vec<EventDocument>,
    /// Value of `cursor` for the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    next: Option<String>,
}

#[derive(Debug, Default, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct EventParameters {
    /// Events of a page, 1 to 1000.
    #[param(value_type = Option<u32>)]
    limit: Option<String>,
    /// Value of `next` of the previous page.
    cursor: Option<String>,
}

/// Lists the events of a robot, newest first.
#[utoipa::path(
    get,
    path = "/robots/{id}/events",
    tag = "robots",
    params(("id" = RobotId, Path, description = "The robot."), EventParameters),
    responses(
        (status = OK, description = "A page of events", body = EventPage),
        (status = NOT_FOUND, description = "The robot is unknown"),
    )
)]
pub(super) async fn list_events(
    State(api): State<ApiState>,
    RobotPath(id): RobotPath,
    Parameters(query): Parameters<EventParameters>,
) -> Result<Response, Problem> {
    let limit = page_limit(query.limit.as_deref())?;
    let before = query.cursor.as_deref().map(number_of).transpose()?;
    known(&api, &id)?;
    let store = api.store.clone();
    let read = move |before, limit| {
        let (store, id) = (store.clone(), id.clone());
        let documents = async move {
            let records = store.events(&id, before, limit).await?;
            let numbered = |record: EventRecord| (record.id.0, EventDocument::of_record(record));
            Ok(records.into_iter().map(numbered).collect())
        };
        documents.boxed()
    };
    listing::page(Rows::new(before, limit, read)).await
}

/// Note of a person or tool for a robot's history.
///
/// Its author is the caller.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[schema(as = NewEvent)]
#[serde(deny_unknown_fields)]
pub(super) struct NewEventDocument {
    /// Kind of the event. After `reassembled` the calibration is compared with the one known just
    /// before.
    kind: NoteKind,
    /// Displayed time of the event, by the robot's clock; its latest estimate's time unless given.
    /// The note takes effect when it is received.
    #[serde(default)]
    #[schema(value_type = Option<String>, format = DateTime)]
    time: Option<Timestamp>,
    /// Note, at most 1000 characters.
    #[serde(default)]
    #[schema(max_length = 1000)]
    note: String,
}

/// Attaches a note to a robot's history, such as "the LiDAR was taken off and put back".
///
/// A note that is answered with 201 reaches the robot's estimator, also after a restart. With an
/// `Idempotency-Key` a repeated request is answered with the same event.
#[utoipa::path(
    post,
    path = "/robots/{id}/events",
    tag = "robots",
    params(
        ("id" = RobotId, Path, description = "The robot."),
        ("Idempotency-Key" = Option<String>, Header,
            description = "The same for each repetition of a request, at most 128 characters."),
    ),
    request_body = NewEventDocument,
    responses(
        (status = CREATED, description = "The stored event", body = EventDocument),
        (status = NOT_FOUND, description = "The robot is unknown"),
        (status = CONFLICT, description = "No estimator takes the note: the robot is not registered, or its estimator is stopped"),
        (status = SERVICE_UNAVAILABLE, description = "Too many notes about the robot wait"),
        (status = UNPROCESSABLE_ENTITY,
            description = "The `Idempotency-Key` came with another request, or the body does not fit"),
    )
)]
pub(super) async fn post_event(
    State(api): State<ApiState>,
    RobotPath(id): RobotPath,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    caller: Caller,
    headers: HeaderMap,
    Body {
        value: body,
        sha256,
    }: Body<NewEventDocument>,
) -> Result<Response, Problem> {
    let view = known(&api, &id)?;
    // Once it is stored, it reaches the estimator whatever happens: what cannot is refused before.
    api.fleet.takes_notes(&id)?;
    let key = idempotency_key(&headers, sha256)?;
    check_length("note", &body.note, limits::NOTE_CHARS_MAX)?;
    let stamp_ns = stamp_of(&body, &view, api.clock.now())?;
    let note = RobotEvent {
        kind: body.kind,
        stamp_ns,
        note: body.note,
    };
    let event = NewEvent {
        robot: id.clone(),
        kind: kind_of_note(note.kind),
        stamp_ns,
        received_ns: api.clock.now(),
        source: EventSource::Person,
        author: Some(caller.actor.name.clone()),
        note: Some(note.note.clone()).filter(|note| !note.is_empty()),
        details: None,
    };
    let author = caller.actor.name.clone();
    let record = robots::note(&api.store, event, caller.actor, key).await?;
    // Of several instances, the one that has the robot takes it from the audit, and all announce it.
    let is_alone = api.membership.cluster().is_none();
    if is_alone && !record.repeated {
        api.fleet.announce(LiveUpdate::Event {
            robot: id.clone(),
            event: Arc::new(HistoryEvent::Note(note)),
            author: Some(author),
        });
        if let Err(error) = notes::bring(&api.store, &api.fleet, &id).await {
            // It is stored: it is brought at the next look.
            api.fleet.want_notes(&id);
            tracing::error!(robot.id = %id, %error, "a note waits");
        }
    }
    Ok((StatusCode::CREATED, Json(EventDocument::of_record(record))).into_response())
}

fn known(api: &ApiState, id: &RobotId) -> Result<RobotView, Problem> {
    api.fleet
        .robot(id)
        .ok_or_else(|| Problem::robot_unknown(id.as_str()))
}

/// Displayed time of a note's event; for the estimator the note takes effect when it is received.
fn stamp_of(
    body: &NewEventDocument,
    view: &RobotView,
    now: WallTime,
) -> Result<RobotTime, Problem> {
    let Some(time) = body.time else {
        return Ok(view
            .estimate
            .as_ref()
            .map_or(RobotTime(now.0), |estimate| estimate.stamp_ns));
    };
    i64::try_from(time.as_nanosecond())
        .ok()
        .filter(|stamp_ns| *stamp_ns > 0)
        .map(RobotTime)
        .ok_or_else(|| Problem::refused("time", &time.to_string(), "a time between 1970 and 2262"))
}
