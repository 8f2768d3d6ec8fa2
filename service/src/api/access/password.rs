//! Password hashing beside the requests, a few at a time.

use std::sync::Arc;

use axum::http::StatusCode;
use tokio::sync::Semaphore;

use crate::access::{Password, PasswordHash};
use crate::api::problem::Problem;
use crate::entropy;
use crate::limits;

/// Hashes passwords on threads of their own. Each takes 19 MiB and a core for a while, so a flood
/// of them waits in a short queue and is then refused.
#[derive(Debug, Clone)]
pub(super) struct PasswordWork {
    running: Arc<Semaphore>,
    places: Arc<Semaphore>,
}

impl Default for PasswordWork {
    fn default() -> Self {
        Self {
            running: Arc::new(Semaphore::new(limits::PASSWORD_HASHES_MAX)),
            places: Arc::new(Semaphore::new(limits::PASSWORD_HASHES_WAITING_MAX)),
        }
    }
}

impl PasswordWork {
    /// Whether `candidate` is the password of `hash`.
    pub(super) async fn verify(
        &self,
        hash: PasswordHash,
        candidate: String,
    ) -> Result<bool, Problem> {
        self.run(move || hash.verify(&candidate)).await
    }

    /// The hash of a new password.
    pub(super) async fn hash(&self, text: &str) -> Result<PasswordHash, Problem> {
        let password = Password::parse(text).map_err(|refused| {
            let status = StatusCode::UNPROCESSABLE_ENTITY;
            Problem::new(status, "password_refused", refused.to_string()).of_field("password")
        })?;
        let salt = entropy::salt().map_err(|error| failed(&error))?;
        self.run(move || PasswordHash::of(&password, &salt))
            .await?
            .map_err(|error| failed(&error))
    }

    async fn run<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, Problem> {
        let place = Arc::clone(&self.places)
            .try_acquire_owned()
            .map_err(|_| busy())?;
        let turn = Arc::clone(&self.running)
            .acquire_owned()
            .await
            .map_err(|_| busy())?;
        let done = tokio::task::spawn_blocking(move || {
            // They go with the work, not with a client that no longer waits for it.
            let _held = (place, turn);
            work()
        });
        done.await.map_err(|error| failed(&error))
    }
}

fn busy() -> Problem {
    let detail = "too many passwords are being checked at the moment";
    Problem::new(StatusCode::SERVICE_UNAVAILABLE, "busy", detail)
}

pub(super) fn failed(error: &impl std::fmt::Display) -> Problem {
    tracing::error!(%error, "a credential could not be made");
    let detail = "the request made the service fail; its log says more";
    Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "failed", detail)
}
