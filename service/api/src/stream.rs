//! Route `GET /stream`: live updates as server-sent events.
//!
//! One task writes each update once for all listeners; each listener receives its topics.

use std::convert::Infallible;
use std::sync::Arc;

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use fleetcal_clock::SharedClock;
use fleetcal_domain::limits;
use fleetcal_fleet::live::LiveUpdate;
use fleetcal_http::{PeerAddress, Share, Shares, Turned, compressed};
use fleetcal_proto::RobotId;
use futures::{StreamExt, stream};
use serde::Deserialize;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, broadcast};
use tokio::time::MissedTickBehavior;
use tokio_stream::wrappers::BroadcastStream;
use tokio_util::sync::CancellationToken;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::access::{Caller, permission_ended};
use super::extract::Parameters;
use super::live_event::{EventName, LiveEvent, NoData, robot_of};
use super::problem::Problem;
use super::robots::RobotStateDocument;
use super::rows::Rows;
use super::standings::ToldStandings;
use super::topics::{Topics, Wanted};
use super::{ApiSetup, ApiState};

/// Update in its written form.
#[derive(Debug)]
struct Frame {
    id: u64,
    name: EventName,
    /// Robot of the update; `None` for one about all.
    robot: Option<RobotId>,
    data: String,
}

/// Hub of the event stream, to which listeners subscribe.
#[derive(Debug, Clone)]
pub(super) struct StreamHub {
    frames: broadcast::Sender<Arc<Frame>>,
    places: Arc<Semaphore>,
    of_caller: Shares,
    of_address: Shares,
    stop: CancellationToken,
}

/// Place of one listener, which is released when this is dropped.
#[derive(Debug)]
struct ListenerPlace {
    _place: OwnedSemaphorePermit,
    _of_caller: Share,
    _of_address: Share,
}

impl StreamHub {
    /// Starts to write the fleet's updates, until `stop`.
    pub(super) fn start(setup: &ApiSetup) -> Self {
        let (frames, _) = broadcast::channel(limits::LIVE_UPDATES_MAX);
        let hub = Self {
            frames,
            places: Arc::new(Semaphore::new(limits::HTTP_STREAMS_MAX)),
            of_caller: Shares::new(limits::HTTP_STREAMS_PER_CALLER_MAX),
            of_address: Shares::new(limits::HTTP_STREAMS_PER_ADDRESS_MAX),
            stop: setup.stop.clone(),
        };
        let (fleet, lifecycle) = (setup.fleet.clone(), setup.lifecycle.clone());
        let writer = Writer {
            live: fleet.live(),
            standings: ToldStandings::new(fleet, lifecycle, setup.evaluator.clone()),
            rows: Rows::default(),
            clock: setup.clock.clone(),
            hub: hub.clone(),
            id: 0,
        };
        tokio::spawn(writer.run());
        hub
    }

    /// Reserves a place for one more listener, unless all, this caller or this address have too
    /// many.
    fn place(&self, caller: &Caller, address: PeerAddress) -> Result<ListenerPlace, Problem> {
        let of_caller = self.of_caller.take(caller.actor.key()).ok_or_else(|| {
            let detail = format!(
                "{} has {} event streams already, which is the limit",
                caller.actor.name,
                limits::HTTP_STREAMS_PER_CALLER_MAX
            );
            Problem::new(StatusCode::TOO_MANY_REQUESTS, "streams_of_caller", detail)
        })?;
        let of_address = self.of_address.take(address.key()).ok_or_else(|| {
            let detail = format!(
                "{} event streams come from this address already, which is the limit",
                limits::HTTP_STREAMS_PER_ADDRESS_MAX
            );
            Problem::new(StatusCode::TOO_MANY_REQUESTS, "streams_of_address", detail)
        })?;
        let place = Arc::clone(&self.places).try_acquire_owned().map_err(|_| {
            let detail = format!(
                "{} listen already, which is the limit",
                limits::HTTP_STREAMS_MAX
            );
            Problem::new(StatusCode::SERVICE_UNAVAILABLE, "streams_full", detail)
        })?;
        Ok(ListenerPlace {
            _place: place,
            _of_caller: of_caller,
            _of_address: of_address,
        })
    }
}

/// Writer of each update, once for all listeners.
#[derive(Debug)]
struct Writer {
    live: broadcast::Receiver<LiveUpdate>,
    standings: ToldStandings,
    rows: Rows,
    clock: SharedClock,
    hub: StreamHub,
    /// Id of the last event.
    id: u64,
}

impl Writer {
    async fn run(mut self) {
        let mut ticks = tokio::time::interval(limits::HTTP_STREAM_ROWS_EVERY);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                () = self.hub.stop.cancelled() => return,
                _ = ticks.tick() => self.tick(),
                update = self.live.recv() => match update {
                    Ok(update) => self.take(&update),
                    Err(broadcast::error::RecvError::Lagged(_)) => {
                        self.tell(None, &LiveEvent::Resync(NoData {}));
                    }
                    Err(broadcast::error::RecvError::Closed) => return,
                },
            }
        }
    }

    /// True if there are listeners: a new one reads the robots first, and receives later changes.
    fn is_heard(&self) -> bool {
        self.hub.frames.receiver_count() > 0
    }

    /// Publishes changed standings that no event was about, and the changed rows.
    fn tick(&mut self) {
        // Also while nobody listens: what changes after somebody has read the robots is told.
        for state in self.standings.all_changed() {
            self.tell_state(state);
        }
        let rows = self.rows.take_new();
        if !self.is_heard() {
            self.rows = Rows::default();
        } else if !rows.is_empty() {
            self.tell(None, &LiveEvent::Rows(&rows));
        }
    }

    fn take(&mut self, update: &LiveUpdate) {
        if !self.is_heard() {
            return;
        }
        if let LiveUpdate::Estimate { robot, document } = update {
            let standing = self.standings.known(robot);
            self.rows.take(robot, standing, document);
        }
        let now = self.clock.now();
        if let Some(event) = LiveEvent::of(update, now) {
            self.tell(robot_of(update), &event);
        }
        let state = match update {
            LiveUpdate::RobotState { robot, .. } => self.standings.now(robot),
            LiveUpdate::Approval { robot } => self.standings.changed(robot),
            LiveUpdate::Alert { robot, .. } => robot
                .as_ref()
                .and_then(|robot| self.standings.changed(robot)),
            // The next tick tells what these have changed.
            LiveUpdate::Estimate { .. }
            | LiveUpdate::Event { .. }
            | LiveUpdate::Freeze
            | LiveUpdate::Policy
            | LiveUpdate::Rollout => None,
        };
        if let Some(state) = state {
            self.tell_state(state);
        }
    }

    fn tell_state(&mut self, state: RobotStateDocument) {
        let robot = state.robot().clone();
        self.rows.take_standing(&robot, state.standing());
        self.tell(Some(&robot), &LiveEvent::RobotState(state));
    }

    fn tell(&mut self, robot: Option<&RobotId>, event: &LiveEvent<'_>) {
        if !self.is_heard() {
            return;
        }
        self.id += 1;
        if let Some(frame) = Frame::of(self.id, robot, event) {
            // Nobody listens any more: nothing is lost.
            drop(self.hub.frames.send(Arc::new(frame)));
        }
    }
}

impl Frame {
    /// Writes an event about a robot (`None`: about all).
    fn of(id: u64, robot: Option<&RobotId>, event: &LiveEvent<'_>) -> Option<Self> {
        Some(Self {
            id,
            name: EventName::from(event),
            robot: robot.cloned(),
            data: event.data()?,
        })
    }
}

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct StreamParameters {
    /// Robot of the updates; all robots unless given.
    #[param(value_type = Option<RobotId>)]
    robot: Option<String>,
    /// Topics of the updates, separated by commas: `fleet` (lean rows and states of all robots),
    /// `robot:ID` (everything about this robot), `alerts`, `approvals`, `deployments` (policy and
    /// deployment freeze). At most 8.
    topics: Option<String>,
}

/// Streams live updates as server-sent events.
///
/// Each is a `LiveEvent`: `event` is its name and `data` its content as JSON. The stream is
/// compressed for a client that accepts gzip, with a flush after each event.
#[utoipa::path(
    get,
    path = "/stream",
    tag = "live",
    params(StreamParameters),
    responses(
        (status = OK, description = "Server-sent events, each a `LiveEvent`", body = LiveEvent,
            content_type = "text/event-stream"),
        (status = TOO_MANY_REQUESTS,
            description = "The caller or its address has too many event streams"),
        (status = SERVICE_UNAVAILABLE,
            description = "Too many listeners, or the database is unavailable"),
    )
)]
pub(super) async fn get_stream(
    State(api): State<ApiState>,
    Parameters(query): Parameters<StreamParameters>,
    caller: Caller,
    address: PeerAddress,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let wanted = wanted(&query)?;
    let gzip = compressed::is_accepted(&headers);
    let hub = api.stream.clone();
    let place = hub
        .place(&caller, address)
        .inspect_err(|_| api.connections.count(Turned::Streams))?;
    let first = if headers.contains_key("last-event-id") {
        LiveEvent::Resync(NoData {})
    } else {
        LiveEvent::Ready(NoData {})
    };
    let first = Event::default()
        .event(EventName::from(&first).as_str())
        .data(first.data().unwrap_or_default())
        .retry(limits::HTTP_STREAM_RETRY);
    let updates = BroadcastStream::new(hub.frames.subscribe())
        .filter_map(move |frame| std::future::ready(event(frame.ok(), &wanted)))
        .take_until(hub.stop.cancelled_owned())
        .take_until(Box::pin(permission_ended(api, caller)));
    let events = stream::once(std::future::ready(first)).chain(updates);
    let keep_alive = KeepAlive::new().interval(limits::HTTP_STREAM_KEEP_ALIVE);
    let stream = Sse::new(holding(place, events)).keep_alive(keep_alive);
    let response = stream.into_response();
    Ok(if gzip {
        compressed::gzip(response)
    } else {
        response
    })
}

/// Stream of one listener, whose place is released when the stream is dropped.
fn holding(
    place: ListenerPlace,
    events: impl stream::Stream<Item = Event>,
) -> impl stream::Stream<Item = Result<Event, Infallible>> {
    events.map(move |event| {
        let _held = &place;
        Ok(event)
    })
}

/// Event of a frame; `None` for a frame outside the listener's topics. A listener that lagged and
/// lost frames receives the request to reload.
fn event(frame: Option<Arc<Frame>>, wanted: &Wanted) -> Option<Event> {
    let Some(frame) = frame else {
        return Some(
            Event::default()
                .event(EventName::Resync.as_str())
                .data("{}"),
        );
    };
    let is_wanted = wanted.includes(frame.name, frame.robot.as_ref());
    is_wanted.then(|| {
        Event::default()
            .id(frame.id.to_string())
            .event(frame.name.as_str())
            .data(frame.data.as_str())
    })
}

fn wanted(query: &StreamParameters) -> Result<Wanted, Problem> {
    match (&query.robot, &query.topics) {
        (None, None) => Ok(Wanted::All),
        (Some(robot), None) => Ok(Wanted::OfRobot(robot_named(robot)?)),
        (None, Some(topics)) => Topics::parse(topics).map(Wanted::Topics),
        (Some(_), Some(topics)) => {
            Err(Problem::refused("topics", topics, "either robot or topics"))
        }
    }
}

fn robot_named(id: &str) -> Result<RobotId, Problem> {
    RobotId::parse(id).map_err(|error| {
        Problem::new(StatusCode::BAD_REQUEST, "value_refused", error.to_string()).of_field("robot")
    })
}

/// Route of the event stream.
pub(super) fn routes() -> OpenApiRouter<ApiState> {
    OpenApiRouter::new().routes(routes!(get_stream))
}
