//! End of a long-running command: the first signal asks, the second one insists.

use fleetcal_command::signals::Signals;
use fleetcal_domain::limits::SHUTDOWN_TIMEOUT;
use fleetcal_store::StoreError;

use crate::service::Service;

/// Exit status after a second signal ended the process at once.
const EXIT_INTERRUPTED: i32 = 130;

/// Stops a service; a second signal ends the process at once, and so does
/// [`SHUTDOWN_TIMEOUT`].
///
/// # Errors
/// [`StoreError::RowsLost`] if some rows could not be stored, or the database's failure.
pub async fn stop_in_time(service: Service, mut signals: Signals) -> Result<(), StoreError> {
    let store = service.store().clone();
    // Its robots go to the other instances first, which takes its own time.
    tokio::select! {
        () = service.leave_cluster() => {}
        () = signals.stop() => std::process::exit(EXIT_INTERRUPTED),
    }
    tokio::select! {
        stopped = service.stop() => stopped,
        () = signals.stop() => std::process::exit(EXIT_INTERRUPTED),
        () = tokio::time::sleep(SHUTDOWN_TIMEOUT) => {
            tracing::error!("the service did not stop in time; what was committed is stored");
            match store.counters().waiting {
                0 => Ok(()),
                rows => {
                    tracing::error!(rows, "rows are lost because they could not be written in time");
                    Err(StoreError::RowsLost { rows, source: None })
                }
            }
        }
    }
}
