//! A robot that asks several instances of the service, of which one is behind and one is frozen.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use fleetcal_model::Generation;
use fleetcal_patience::until;
use fleetcal_proto::calibration::{Applied, AppliedStatus};
use fleetcal_proto::{Keys, StreamKind};
use tokio::time::Instant;
use zenoh::Wait;
use zenoh::query::{Query, Queryable};

use super::service::{Service, question_of};
use super::wire::Robot;
use super::*;

/// Another instance, with a session of its own.
struct Other {
    /// Session, open while it lives.
    _session: zenoh::Session,
    _queryable: Queryable<()>,
}

impl Other {
    async fn answering(endpoint: &str, answer: impl Fn(Query) + Send + Sync + 'static) -> Self {
        let mut config = zenoh::Config::default();
        for (key, value) in [
            ("mode", "\"client\"".to_owned()),
            ("connect/endpoints", format!("[\"{endpoint}\"]")),
            ("scouting/multicast/enabled", "false".to_owned()),
        ] {
            config.insert_json5(key, &value).unwrap();
        }
        let session = zenoh::open(config).await.unwrap();
        let key = Keys::default().stream_of_all(StreamKind::CalibrationApproved);
        let queryable = session.declare_queryable(key).callback(answer);
        Self {
            _queryable: queryable.await.unwrap(),
            _session: session,
        }
    }

    /// Makes an instance that has not received the latest approval.
    async fn behind(endpoint: &str, envelope: Envelope) -> Self {
        let key = Keys::default().stream(&robot(), StreamKind::CalibrationApproved);
        let answer = move |query: Query| {
            let offered = wanted(&envelope, question_of(&query));
            let payload = serde_json::to_vec(&offered).unwrap();
            query.reply(&key, payload).wait().unwrap();
        };
        Self::answering(endpoint, answer).await
    }

    /// Makes an instance that receives queries and never answers, with the queries so far.
    async fn frozen(endpoint: &str) -> (Self, Arc<Mutex<Vec<Query>>>) {
        let heard: Arc<Mutex<Vec<Query>>> = Arc::default();
        let keeps = Arc::clone(&heard);
        let answer = move |query| keeps.lock().unwrap().push(query);
        (Self::answering(endpoint, answer).await, heard)
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn of_what_several_instances_say_the_newest_counts() {
    let service = Service::start().await;
    service.store(&sealed(&document(5)));
    let _behind = Other::behind(&service.endpoint, sealed(&document(4))).await;
    let (_frozen, heard) = Other::frozen(&service.endpoint).await;
    let mut robot = Robot::new(&service.endpoint);
    let began = Instant::now();
    robot.start();
    service.wait_for(5, AppliedStatus::Applied).await;
    println!("in use after {:.2} s", began.elapsed().as_secs_f64());
    until("the frozen one was asked", || {
        !heard.lock().unwrap().is_empty()
    })
    .await;
    // What the robot holds is asked for again, and what is behind leaves no trace.
    robot.settles().await;
    assert_eq!(robot.stop().await, 5);
    robot.start();
    let asked = heard.lock().unwrap().len();
    until("all are asked again", || {
        heard.lock().unwrap().len() > asked
    })
    .await;
    tokio::time::sleep(Duration::from_secs(2)).await;
    let answers = service.answers();
    let is_of_old = |answer: &Applied| answer.generation == Generation(4);
    assert!(!answers.iter().any(is_of_old), "{answers:?}");
    assert_eq!(robot.stop().await, 5);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_somebody_else_signed_is_not_newer() {
    let service = Service::start().await;
    service.store(&sealed(&document(5)));
    let forged = seal(&document(9), &strange_key()).unwrap();
    let _forger = Other::behind(&service.endpoint, forged).await;
    let mut robot = Robot::new(&service.endpoint);
    robot.start();
    service.wait_for(5, AppliedStatus::Applied).await;
    assert_eq!(robot.stop().await, 5);
}
