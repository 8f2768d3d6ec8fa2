//! Queries of robots over Zenoh that the database answers, with a limit.

use std::sync::Arc;

use fleetcal_domain::limits;
use fleetcal_fleet::FleetHandle;
use tokio::runtime::Handle;
use tokio::sync::Semaphore;

/// Queue of queries for the database. Cheap to clone; all clones share the places.
#[derive(Debug, Clone)]
pub struct Questions {
    places: Arc<Semaphore>,
    fleet: FleetHandle,
    runtime: Handle,
}

impl Questions {
    /// Makes [`limits::QUESTIONS_MAX`] places, on the runtime that this is called in.
    pub fn new(fleet: FleetHandle) -> Self {
        Self::with_places(fleet, limits::QUESTIONS_MAX)
    }

    fn with_places(fleet: FleetHandle, places: usize) -> Self {
        Self {
            places: Arc::new(Semaphore::new(places)),
            fleet,
            runtime: Handle::current(),
        }
    }

    /// Answers a query by `answer`. It never blocks, as Zenoh's threads must not wait for the
    /// database. A query without a place is counted and not answered: agents repeat it.
    pub fn answer(&self, answer: impl Future<Output = ()> + Send + 'static) {
        let Ok(place) = Arc::clone(&self.places).try_acquire_owned() else {
            self.fleet.count_unanswered_question();
            return;
        };
        self.runtime.spawn(async move {
            answer.await;
            drop(place);
        });
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use fleetcal_clock::MockClock;
    use fleetcal_contract::TestDatabase;
    use fleetcal_estimator::EstimatorSettings;
    use fleetcal_fleet::FleetSetup;
    use tokio::sync::oneshot;

    use super::*;

    async fn empty_fleet(database: &TestDatabase) -> FleetHandle {
        let clock = MockClock::at(1_763_700_000_000_000_000);
        let store = database.open(clock.clone()).await;
        FleetHandle::start(FleetSetup {
            clock,
            journal: Arc::new(store),
            estimator: EstimatorSettings::default(),
            robots: BTreeMap::new(),
            cross_tracks: BTreeMap::new(),
            checkpoints: BTreeMap::new(),
            last_heard: BTreeMap::new(),
            audited: fleetcal_model::AuditId(0),
            membership: fleetcal_cluster::Membership::alone(),
        })
    }

    #[tokio::test]
    async fn a_question_too_many_is_counted_and_a_place_comes_back() {
        let database = TestDatabase::new().await;
        let fleet = empty_fleet(&database).await;
        let questions = Questions::with_places(fleet.clone(), 2);
        let ask = || {
            let (go, wait) = oneshot::channel::<()>();
            let (told, answered) = oneshot::channel();
            questions.answer(async move {
                wait.await.ok();
                told.send(()).ok();
            });
            (go, answered)
        };
        let (first, second, third) = (ask(), ask(), ask());
        assert_eq!(fleet.counters().unanswered_questions, 1);
        assert!(third.1.await.is_err(), "it is dropped");
        first.0.send(()).unwrap();
        first.1.await.unwrap();
        // The place comes back with the end of the task.
        while questions.places.available_permits() == 0 {
            tokio::task::yield_now().await;
        }
        let fourth = ask();
        for (go, answered) in [second, fourth] {
            go.send(()).unwrap();
            answered.await.unwrap();
        }
        assert_eq!(fleet.counters().unanswered_questions, 1);
    }
}
