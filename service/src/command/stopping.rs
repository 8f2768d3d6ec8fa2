//! How a long-running command ends: the first signal asks, the second one insists.

use tokio::signal::unix::{Signal, SignalKind, signal};

use crate::limits::SHUTDOWN_TIMEOUT;
use crate::service::Service;

/// What the shell is told when a second signal ended the process at once.
const EXIT_INTERRUPTED: i32 = 130;

/// SIGTERM and SIGINT.
#[derive(Debug)]
pub struct Signals {
    terminate: Signal,
    interrupt: Signal,
}

impl Signals {
    /// Takes both signals from now on.
    ///
    /// # Errors
    /// When the system does not allow it.
    pub fn listen() -> std::io::Result<Self> {
        Ok(Self {
            terminate: signal(SignalKind::terminate())?,
            interrupt: signal(SignalKind::interrupt())?,
        })
    }

    /// Waits for either.
    pub async fn stop(&mut self) {
        tokio::select! {
            _ = self.terminate.recv() => {}
            _ = self.interrupt.recv() => {}
        }
    }
}

/// Stops a service; a second signal ends the process at once, and so does
/// [`SHUTDOWN_TIMEOUT`].
pub async fn stop_in_time(service: Service, mut signals: Signals) {
    tokio::select! {
        () = service.stop() => {}
        () = signals.stop() => std::process::exit(EXIT_INTERRUPTED),
        () = tokio::time::sleep(SHUTDOWN_TIMEOUT) => {
            tracing::error!("the service did not stop in time; what was committed is stored");
        }
    }
}
