//! `GET /stream`: live updates as server-sent events.
//!
//! One task writes each update once, however many listen.

use std::convert::Infallible;
use std::sync::Arc;

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::IntoResponse;
use axum::response::sse::{Event, KeepAlive, Sse};
use fleetcal_proto::RobotId;
use futures::{StreamExt, stream};
use serde::{Deserialize, Serialize};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, broadcast};
use tokio_stream::wrappers::BroadcastStream;
use tokio_util::sync::CancellationToken;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::ApiState;
use super::access::{Caller, permission_ended};
use super::extract::Parameters;
use super::problem::Problem;
use super::robots::{EventDocument, state_document};
use crate::alert::AlertDocument;
use crate::clock::SharedClock;
use crate::fleet::{FleetHandle, LiveUpdate};
use crate::limits;
use crate::store::NewEvent;

/// One update, written out.
#[derive(Debug)]
struct Frame {
    id: u64,
    kind: &'static str,
    /// Whom it is about; `None` for all.
    robot: Option<RobotId>,
    data: String,
}

/// Where listeners of the event stream come to.
#[derive(Debug, Clone)]
pub(super) struct StreamHub {
    frames: broadcast::Sender<Arc<Frame>>,
    places: Arc<Semaphore>,
    stop: CancellationToken,
}

impl StreamHub {
    /// Starts to write out what the fleet tells, until `stop`.
    pub(super) fn start(fleet: &FleetHandle, clock: SharedClock, stop: CancellationToken) -> Self {
        let (frames, _) = broadcast::channel(limits::LIVE_UPDATES_MAX);
        let hub = Self {
            frames,
            places: Arc::new(Semaphore::new(limits::HTTP_STREAMS_MAX)),
            stop,
        };
        tokio::spawn(hub.clone().write_out(fleet.live(), clock));
        hub
    }

    async fn write_out(self, mut live: broadcast::Receiver<LiveUpdate>, clock: SharedClock) {
        let mut id = 0;
        loop {
            let update = tokio::select! {
                () = self.stop.cancelled() => return,
                update = live.recv() => update,
            };
            id += 1;
            let frame = match update {
                Ok(_) if self.frames.receiver_count() == 0 => continue,
                Ok(update) => frame(id, &update, clock.now_ns()),
                Err(broadcast::error::RecvError::Lagged(_)) => Some(resync(id)),
                Err(broadcast::error::RecvError::Closed) => return,
            };
            if let Some(frame) = frame {
                // Nobody listens any more: nothing is lost.
                drop(self.frames.send(Arc::new(frame)));
            }
        }
    }
}

fn frame(id: u64, update: &LiveUpdate, now_ns: i64) -> Option<Frame> {
    let (kind, robot, data) = match update {
        LiveUpdate::Estimate { robot, document } => ("estimate", robot, json(document.as_ref())?),
        LiveUpdate::RobotState {
            robot,
            state,
            stale,
            alive,
        } => (
            "robot_state",
            robot,
            json(&state_document(robot, *state, *stale, *alive))?,
        ),
        LiveUpdate::Approval { robot } => (
            "approval",
            robot,
            json(&serde_json::json!({ "robot": robot }))?,
        ),
        LiveUpdate::Alert { robot, alert } => ("alert", robot, json(&AlertDocument::of(alert))?),
        LiveUpdate::Event { robot, event } => {
            let document = EventDocument::of(NewEvent::of(robot, event, now_ns));
            ("event", robot, json(&document)?)
        }
    };
    Some(Frame {
        id,
        kind,
        robot: Some(robot.clone()),
        data,
    })
}

fn json<T: Serialize>(document: &T) -> Option<String> {
    serde_json::to_string(document)
        .inspect_err(|error| tracing::error!(%error, "a live update cannot be written"))
        .ok()
}

/// Tells a listener that it missed something and should read again what it shows.
fn resync(id: u64) -> Frame {
    Frame {
        id,
        kind: "resync",
        robot: None,
        data: "{}".to_owned(),
    }
}

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct StreamParameters {
    /// Only updates of this robot; of all unless given.
    #[param(value_type = Option<RobotId>)]
    robot: Option<String>,
}

/// Streams live updates as server-sent events: `estimate` (`EstimateDocument`, once a second and
/// robot), `robot_state` (`RobotStateUpdate`), `event` (`Event`), `alert` (`Alert`, with each change
/// of one; state `normal` is its end), and `resync` when updates were
/// missed and the client should read again what it shows. It begins with `ready`, or with `resync`
/// when the client says by `Last-Event-ID` that it was here before.
#[utoipa::path(
    get,
    path = "/stream",
    tag = "live",
    params(StreamParameters),
    responses(
        (status = OK, description = "Server-sent events", body = String,
            content_type = "text/event-stream"),
        (status = "4XX", description = "Refused", body = Problem,
            content_type = "application/problem+json"),
        (status = SERVICE_UNAVAILABLE, description = "Too many listen", body = Problem,
            content_type = "application/problem+json"),
    )
)]
pub(super) async fn get_stream(
    State(api): State<ApiState>,
    Parameters(query): Parameters<StreamParameters>,
    caller: Caller,
    headers: HeaderMap,
) -> Result<impl IntoResponse, Problem> {
    let robot = query.robot.as_deref().map(robot_named).transpose()?;
    let hub = api.stream.clone();
    let place = Arc::clone(&hub.places).try_acquire_owned().map_err(|_| {
        let detail = format!(
            "{} listen already, which is the limit",
            limits::HTTP_STREAMS_MAX
        );
        Problem::new(StatusCode::SERVICE_UNAVAILABLE, "streams_full", detail)
    })?;
    let first = if headers.contains_key("last-event-id") {
        "resync"
    } else {
        "ready"
    };
    let first = Event::default()
        .event(first)
        .data("{}")
        .retry(limits::HTTP_STREAM_RETRY);
    let updates = BroadcastStream::new(hub.frames.subscribe())
        .filter_map(move |frame| std::future::ready(event(frame.ok(), robot.as_ref())))
        .take_until(hub.stop.cancelled_owned())
        .take_until(Box::pin(permission_ended(api, caller)));
    let events = stream::once(std::future::ready(first)).chain(updates);
    let keep_alive = KeepAlive::new().interval(limits::HTTP_STREAM_KEEP_ALIVE);
    Ok(Sse::new(holding(place, events)).keep_alive(keep_alive))
}

/// The stream of one listener, whose place is free again when the stream goes.
fn holding(
    place: OwnedSemaphorePermit,
    events: impl stream::Stream<Item = Event>,
) -> impl stream::Stream<Item = Result<Event, Infallible>> {
    events.map(move |event| {
        let _held = &place;
        Ok(event)
    })
}

/// A frame as an event; `None` for a frame that the listener did not ask for. A listener that
/// lagged behind and lost frames is told to read again.
fn event(frame: Option<Arc<Frame>>, robot: Option<&RobotId>) -> Option<Event> {
    let Some(frame) = frame else {
        return Some(Event::default().event("resync").data("{}"));
    };
    let wanted = match (robot, &frame.robot) {
        (Some(robot), Some(about)) => robot == about,
        _ => true,
    };
    wanted.then(|| {
        Event::default()
            .id(frame.id.to_string())
            .event(frame.kind)
            .data(frame.data.as_str())
    })
}

fn robot_named(id: &str) -> Result<RobotId, Problem> {
    RobotId::parse(id).map_err(|error| {
        Problem::new(StatusCode::BAD_REQUEST, "value_refused", error.to_string()).of_field("robot")
    })
}

/// The route of the event stream.
pub(super) fn routes() -> OpenApiRouter<ApiState> {
    OpenApiRouter::new().routes(routes!(get_stream))
}
