//! Password hashing beside the requests, a few at a time.

use std::sync::Arc;

use axum::http::StatusCode;
use fleetcal_domain::access::{Password, PasswordHash};
use fleetcal_domain::limits;
use fleetcal_http::Whose;
use fleetcal_operations::entropy;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use crate::problem::Problem;

/// Hashes passwords on threads of their own. Each needs 19 MiB and a core for a while, so a flood
/// of them waits in a short queue and is then refused. Strangers never get the last thread, nor the
/// queue places of known clients.
#[derive(Debug, Clone)]
pub struct PasswordWork {
    running: Arc<Semaphore>,
    strangers: Arc<Semaphore>,
    places: Arc<Semaphore>,
    places_known: Arc<Semaphore>,
}

impl Default for PasswordWork {
    fn default() -> Self {
        let semaphore = |permits| Arc::new(Semaphore::new(permits));
        Self {
            running: semaphore(limits::PASSWORD_HASHES_MAX),
            strangers: semaphore(limits::PASSWORD_HASHES_OF_STRANGERS_MAX),
            places: semaphore(limits::PASSWORD_HASHES_WAITING_MAX),
            places_known: semaphore(limits::PASSWORD_HASHES_KNOWN_WAITING_MAX),
        }
    }
}

impl PasswordWork {
    /// True if `candidate` is the password of `hash`.
    ///
    /// # Errors
    /// Too many passwords wait, or the thread failed.
    pub async fn verify(
        &self,
        whose: Whose,
        hash: PasswordHash,
        candidate: String,
    ) -> Result<bool, Problem> {
        self.run(whose, move || hash.verify(&candidate)).await
    }

    /// Hashes a new password.
    ///
    /// # Errors
    /// It is no acceptable password, too many wait, or the system has no random bytes.
    pub async fn hash(&self, text: &str) -> Result<PasswordHash, Problem> {
        let password = Password::parse(text).map_err(|refused| {
            let status = StatusCode::UNPROCESSABLE_ENTITY;
            Problem::new(status, "password_refused", refused.to_string()).of_field("password")
        })?;
        let salt = entropy::salt().map_err(|error| failed(&error))?;
        self.run(Whose::Known, move || PasswordHash::of(&password, &salt))
            .await?
            .map_err(|error| failed(&error))
    }

    async fn run<T: Send + 'static>(
        &self,
        whose: Whose,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, Problem> {
        let places = match whose {
            Whose::Known => &self.places_known,
            Whose::Stranger => &self.places,
        };
        let place = Arc::clone(places).try_acquire_owned().map_err(|_| busy())?;
        let among_strangers = match whose {
            Whose::Known => None,
            Whose::Stranger => Some(turn(&self.strangers).await?),
        };
        let running = turn(&self.running).await?;
        let done = tokio::task::spawn_blocking(move || {
            // They go with the work, not with a client that no longer waits for it.
            let _held = (place, among_strangers, running);
            work()
        });
        done.await.map_err(|error| failed(&error))
    }
}

async fn turn(semaphore: &Arc<Semaphore>) -> Result<OwnedSemaphorePermit, Problem> {
    let acquired = Arc::clone(semaphore).acquire_owned().await;
    acquired.map_err(|_| busy())
}

fn busy() -> Problem {
    let detail = "too many passwords are being checked at the moment";
    Problem::new(StatusCode::SERVICE_UNAVAILABLE, "busy", detail)
}

/// Makes the problem of a credential that could not be made, and logs its cause.
pub fn failed(error: &impl std::fmt::Display) -> Problem {
    tracing::error!(%error, "a credential could not be made");
    let detail = "the service failed; its log has the details";
    Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "failed", detail)
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use super::*;

    #[tokio::test]
    async fn strangers_leave_a_thread_and_places_to_those_who_are_known() {
        let work = PasswordWork::default();
        let (go, waits) = mpsc::channel::<()>();
        let first = work.clone();
        let first =
            tokio::spawn(async move { first.run(Whose::Stranger, move || waits.recv()).await });
        let mut waiting = Vec::new();
        for _ in 1..limits::PASSWORD_HASHES_WAITING_MAX {
            let work = work.clone();
            waiting.push(tokio::spawn(async move {
                work.run(Whose::Stranger, || ()).await
            }));
        }
        while work.places.available_permits() > 0 {
            tokio::task::yield_now().await;
        }
        assert_eq!(work.run(Whose::Stranger, || ()).await.unwrap_err(), busy());
        assert_eq!(work.run(Whose::Known, || 7).await, Ok(7));
        drop(go);
        assert!(first.await.unwrap().unwrap().is_err(), "nothing was sent");
        for waiting in waiting {
            assert_eq!(waiting.await.unwrap(), Ok(()));
        }
    }
}
