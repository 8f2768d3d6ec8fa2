//! Route `GET /robots/{id}/recording`: a live recording of a robot, as MCAP for Foxglove.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use fleetcal_domain::limits;
use fleetcal_http::WritePatience;
use fleetcal_operations::recording_export::live::{self, LiveError, Patience};
use fleetcal_proto::RobotId;
use futures::{Stream, StreamExt, stream};
use serde::Deserialize;
use tokio::sync::{Semaphore, mpsc, oneshot};
use tokio_stream::wrappers::ReceiverStream;
use tokio_util::sync::CancellationToken;

use crate::ApiState;
use crate::access::{Caller, permission_ended};
use crate::extract::{Parameters, number_within};
use crate::forwarding::OwnRobot;
use crate::problem::Problem;

/// State that recordings share.
#[derive(Debug, Clone)]
pub(crate) struct Recordings {
    places: Arc<Semaphore>,
    /// Token that ends them all.
    stop: CancellationToken,
}

impl Recordings {
    /// Makes the state of a service that runs until `stop`.
    pub(crate) fn new(stop: CancellationToken) -> Self {
        let places = Arc::new(Semaphore::new(limits::RECORDINGS_MAX));
        Self { places, stop }
    }
}

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct RecordingParameters {
    /// Duration of the recording, s, 1 to 3600; 60 unless given.
    #[param(value_type = Option<u32>)]
    duration_s: Option<String>,
}

/// File in the MCAP format.
#[derive(utoipa::ToSchema)]
#[schema(value_type = String, format = Binary)]
#[expect(dead_code, reason = "a schema; the file is written piece by piece")]
pub(super) struct RecordingFile(Vec<u8>);

/// Records a robot from now on and returns the recording while it is written: an MCAP file of ROS 2
/// messages in CDR, which Foxglove, `rosbag2` and `rosbags` open.
///
/// It has the robot's own messages, those in JSON converted, `/tf`, `/{robot}/estimate` and `/{robot}/events`, all logged by
/// the robot's clock. It is complete after `duration_s`, at 1 GiB, or when the permission ends, for
/// clients that read the rest within 30 s; and when the service stops, for clients that do within 2
/// s. Otherwise, and if nothing is read for 30 s, the connection is closed and the file lacks its
/// end. The service keeps no copy. Messages that arrived faster than they were read are missing;
/// the metadata `fleetcal.session` report how many.
#[utoipa::path(
    get,
    path = "/robots/{id}/recording",
    tag = "robots",
    params(("id" = RobotId, Path, description = "The robot."), RecordingParameters),
    responses(
        (status = OK, description = "The recording", body = inline(RecordingFile),
            content_type = "application/octet-stream"),
        (status = NOT_FOUND, description = "The robot is unknown"),
        (status = CONFLICT, description = "The robot is not registered"),
        (status = SERVICE_UNAVAILABLE,
            description = "Too many recordings are made at once, no instance has the robot, or the \
                request took too long"),
    )
)]
pub(super) async fn get_recording(
    State(api): State<ApiState>,
    OwnRobot(id): OwnRobot,
    Parameters(query): Parameters<RecordingParameters>,
    caller: Caller,
) -> Result<Response, Problem> {
    let seconds = number_within(
        "duration_s",
        query.duration_s.as_deref(),
        1..=limits::RECORDING_DURATION_MAX_S,
        limits::RECORDING_DURATION_DEFAULT_S,
    )?;
    let places = Arc::clone(&api.recordings.places);
    let place = places.try_acquire_owned().map_err(|_| {
        let detail = format!(
            "{} recordings are made already, which is the limit",
            limits::RECORDINGS_MAX
        );
        Problem::new(StatusCode::SERVICE_UNAVAILABLE, "recordings_full", detail)
    })?;
    let tap = api.fleet.tap(&id)?;
    let (pieces, receiver) = mpsc::channel(limits::RECORDING_PIECES_WAITING_MAX);
    let (ended, outcome) = oneshot::channel();
    let file = HeaderValue::try_from(format!("attachment; filename=\"{id}.mcap\""));
    let stop = api.recordings.stop.clone();
    tokio::spawn(async move {
        let end = async {
            tokio::select! {
                () = tokio::time::sleep(Duration::from_secs(seconds.into())) => {}
                () = stop.cancelled() => {}
                () = permission_ended(api, caller) => {}
            }
        };
        let outcome = live::record(id.clone(), tap, pieces, Patience::default(), end).await;
        if let Err(error) = &outcome {
            tracing::warn!(robot.id = %id, %error, "a recording ended before it was complete");
        }
        drop(place);
        // Whoever fetched it may have gone.
        drop(ended.send(outcome));
    });
    let mut response = Body::from_stream(file_of(receiver, outcome)).into_response();
    let patience = WritePatience(limits::RECORDING_STALLED_AFTER);
    response.extensions_mut().insert(patience);
    let headers = response.headers_mut();
    let bytes = HeaderValue::from_static("application/octet-stream");
    headers.insert(header::CONTENT_TYPE, bytes);
    if let Ok(file) = file {
        headers.insert(header::CONTENT_DISPOSITION, file);
    }
    // It is packed already.
    let identity = HeaderValue::from_static("identity");
    headers.insert(header::CONTENT_ENCODING, identity);
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    Ok(response)
}

/// Pieces of a recording, followed by an error unless it is complete: the error closes the
/// connection, so that no client accepts an incomplete file.
fn file_of(
    pieces: mpsc::Receiver<Vec<u8>>,
    outcome: oneshot::Receiver<Result<(), LiveError>>,
) -> impl Stream<Item = io::Result<Vec<u8>>> {
    let broken_off = stream::once(outcome).filter_map(|outcome| {
        std::future::ready(match outcome {
            Ok(Ok(())) => None,
            Ok(Err(error)) => Some(Err(io::Error::other(error))),
            Err(gone) => Some(Err(io::Error::other(gone))),
        })
    });
    ReceiverStream::new(pieces).map(Ok).chain(broken_off)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stream of two pieces with this outcome.
    async fn file(outcome: Option<Result<(), LiveError>>) -> Vec<io::Result<Vec<u8>>> {
        let (pieces, receiver) = mpsc::channel(2);
        for piece in [vec![1], vec![2]] {
            pieces.send(piece).await.unwrap();
        }
        drop(pieces);
        let (ended, ending) = oneshot::channel();
        match outcome {
            Some(outcome) => ended.send(outcome).unwrap(),
            None => drop(ended),
        }
        file_of(receiver, ending).collect().await
    }

    #[tokio::test]
    async fn a_recording_without_its_end_ends_with_an_error() {
        let whole = file(Some(Ok(()))).await;
        assert!(whole.len() == 2 && whole.iter().all(Result::is_ok));
        let waited = Duration::from_secs(30);
        for outcome in [Some(Err(LiveError::RestNotTaken(waited))), None] {
            let broken = file(outcome).await;
            assert_eq!(broken.len(), 3, "both pieces come first");
            assert!(broken[0].is_ok() && broken[1].is_ok() && broken[2].is_err());
        }
    }
}
