//! An instance that is frozen between the question at its gate and the put.

use std::sync::Condvar;
use std::thread;

use fleetcal_model::WallTime;
use tokio::runtime::{Builder, Runtime};

use super::*;

/// Name of the threads that can be frozen.
const FREEZABLE: &str = "freezable";
/// Time in which every task checks the gate at least once, on a busy machine too; each does so once
/// a second.
const ALL_HAVE_ASKED: Duration = Duration::from_secs(3);
/// Time in which a new estimate is certainly not published yet, since estimates are published once
/// a second.
const BEFORE_THE_NEXT_PUT: Duration = Duration::from_millis(700);

/// Clock that freezes the thread that reads the running time, after reading it: the thread's next
/// action rests on an outdated time.
#[derive(Debug)]
struct FreezingClock {
    clock: Arc<MockClock>,
    freezes: Mutex<bool>,
    thawed: Condvar,
}

impl FreezingClock {
    fn of(clock: Arc<MockClock>) -> Arc<Self> {
        Arc::new(Self {
            clock,
            freezes: Mutex::new(false),
            thawed: Condvar::new(),
        })
    }

    fn freeze(&self) {
        *self.freezes.lock().unwrap() = true;
    }

    fn thaw(&self) {
        *self.freezes.lock().unwrap() = false;
        self.thawed.notify_all();
    }
}

impl Clock for FreezingClock {
    fn now(&self) -> WallTime {
        self.clock.now()
    }

    fn elapsed(&self) -> Duration {
        self.clock.elapsed()
    }

    fn uptime(&self) -> Duration {
        let now = self.clock.uptime();
        // Zenoh's threads are those of all sessions of this process.
        if thread::current().name() == Some(FREEZABLE) {
            // Other tasks go on until they ask as well.
            tokio::task::block_in_place(|| {
                let freezes = self.freezes.lock().unwrap();
                drop(self.thawed.wait_while(freezes, |freezes| *freezes).unwrap());
            });
        }
        now
    }
}

/// Makes a runtime that runs a link's tasks on threads of its own.
fn threads() -> Runtime {
    let threads = Builder::new_multi_thread()
        .worker_threads(2)
        .thread_name(FREEZABLE)
        .enable_all()
        .build();
    threads.unwrap()
}

/// Checks the one late put that the model of the cluster permits (`cluster/tests/model/`): robots
/// and tools recognise it by its epoch.
#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn an_instance_frozen_between_gate_and_put_puts_one_late_estimate() {
    let endpoint = free_endpoint();
    let router = session("router", "listen/endpoints", &endpoint).await;
    let threads = threads();
    let mut freezing = None;
    let open = async |setup, fleet, lifecycle, clock: Arc<MockClock>| {
        let clock = FreezingClock::of(clock);
        freezing = Some(Arc::clone(&clock));
        let opened = threads.spawn(Link::open(setup, fleet, lifecycle, clock));
        opened.await.unwrap().unwrap()
    };
    let a = Instance::linked_by("a", &endpoint, open).await;
    let freezing = freezing.unwrap();
    let b = Instance::join("b", &endpoint).await;
    let robots = Robots::connect(&endpoint).await;
    for robot in ROBOTS {
        a.adopt(robot, 1).await;
    }
    robots.drive().await;
    let mut processed = 100;
    until_answered("new estimates wait to be put", async || {
        let by_a = async || !robots.estimated_by(ROBOTS[0]).is_empty();
        until_answered("estimates are put", by_a).await;
        robots.drive().await;
        processed += 100;
        let all_processed = async || ROBOTS.iter().all(|robot| a.processed(robot) == processed);
        let made = until_answered("new ones are made", all_processed);
        tokio::time::timeout(BEFORE_THE_NEXT_PUT, made)
            .await
            .is_ok()
    })
    .await;
    freezing.freeze();
    tokio::time::sleep(ALL_HAVE_ASKED).await;
    for robot in ROBOTS {
        robots.estimated_by(robot);
    }
    // Its lease ends meanwhile, and its robots are another one's.
    a.clock.advance(limits::CLUSTER_LEASE);
    for robot in ROBOTS {
        b.adopt(robot, 2).await;
    }
    robots.drive().await;
    for robot in ROBOTS {
        let mut taken_over = Vec::new();
        until_answered("the other one puts estimates", async || {
            taken_over.extend(robots.estimated_by(robot));
            !taken_over.is_empty()
        })
        .await;
        assert!(taken_over.iter().all(|one| *one == Some(by("b", 2))));
    }

    freezing.thaw();
    tokio::time::sleep(Duration::from_millis(2_500)).await;
    let late = ROBOTS.map(|robot| robots.estimated_by(robot)).concat();
    let late: Vec<_> = late
        .into_iter()
        .filter(|one| *one != Some(by("b", 2)))
        .collect();
    assert_eq!(
        late,
        [Some(by("a", 1))],
        "it was frozen where it was meant to"
    );
    a.leave().await;
    b.leave().await;
    drop(router);
    threads.shutdown_background();
}
