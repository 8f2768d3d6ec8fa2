//! Files of many rows: the limits of their number and duration.

use std::io;

use axum::body::{Body, Bytes};
use axum::http::StatusCode;
use fleetcal_domain::limits;
use fleetcal_http::{ExportPlace, ExportRefused, Turned, until};
use futures::Stream;

use crate::ApiState;
use crate::access::{Caller, permission_ended};
use crate::problem::Problem;

/// Time that a caller should wait before its next attempt, s: a file of the audit takes some
/// seconds.
const RETRY_AFTER_S: u32 = 10;

/// File of a caller that has a place for it.
#[derive(Debug)]
pub(crate) struct Export {
    api: ApiState,
    caller: Caller,
    place: ExportPlace,
}

impl Export {
    /// Reserves a place for a file of this caller.
    ///
    /// # Errors
    /// [`Problem`] if the caller, or all of them together, have as many files as permitted.
    pub(crate) fn begin(api: &ApiState, caller: Caller) -> Result<Self, Problem> {
        let place = api.exports.take(caller.actor.key());
        let place = place.inspect_err(|_| api.connections.count(Turned::Exports));
        Ok(Self {
            place: place.map_err(refused)?,
            api: api.clone(),
            caller,
        })
    }

    /// Body of the file. It is cut off if the caller loses the permission, or takes too long.
    pub(crate) fn body(
        self,
        pieces: impl Stream<Item = io::Result<Bytes>> + Send + 'static,
    ) -> Body {
        let Self { api, caller, place } = self;
        let end = async move {
            tokio::select! {
                () = permission_ended(api, caller) => "the permission has ended",
                () = tokio::time::sleep(limits::EXPORT_TAKEN_WITHIN) => "it was not taken in time",
            }
        };
        Body::from_stream(until(end, pieces, place))
    }
}

fn refused(reason: ExportRefused) -> Problem {
    let (status, code, detail) = match reason {
        ExportRefused::OfCaller => (
            StatusCode::TOO_MANY_REQUESTS,
            "exports_of_caller",
            format!(
                "{} files are written for this user or token, which is the limit",
                limits::EXPORTS_PER_CALLER_MAX
            ),
        ),
        ExportRefused::Full => (
            StatusCode::SERVICE_UNAVAILABLE,
            "exports_full",
            format!(
                "{} files are written already, which is the limit",
                limits::EXPORTS_MAX
            ),
        ),
    };
    Problem::new(status, code, detail).retry_after(RETRY_AFTER_S)
}
