//! ROS 2 robots that run none of our software: `rmw_zenoh`, and `zenoh-bridge-ros2dds`.
//!
//! Which keys are theirs follows from `[ros2]` and from each robot's `streams`, so the
//! subscriptions move with the robots that are registered or previewed. What robots announce by
//! liveliness tokens is shown before anybody has registered them.

pub mod access;
pub mod calibration;
mod description;
mod discovery;
mod graph;
mod routes;
mod subscribe;

pub use routes::RouteTable;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock, RwLockReadGuard};

use fleetcal_clock::SharedClock;
use fleetcal_domain::limits;
use fleetcal_fleet::FleetHandle;
use fleetcal_operations::lifecycle::Lifecycle;
use fleetcal_proto::RobotId;
use fleetcal_proto::ros2_key::KeyLayout;
use tokio::sync::{Notify, mpsc, watch};
use tokio::task::JoinHandle;
use tokio::time::{Instant, MissedTickBehavior};
use tokio_util::sync::CancellationToken;
use zenoh::pubsub::Subscriber;
use zenoh::query::Queryable;
use zenoh::{Result, Session};

use crate::gate::Gate;
use crate::heard::HeardStreams;
use crate::questions::Questions;
use calibration::Home;
use discovery::Discovery;
use subscribe::Subscriptions;

/// State that all callbacks share. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Ros2 {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    fleet: FleetHandle,
    clock: SharedClock,
    gate: Gate,
    table: RwLock<RouteTable>,
    discovery: Mutex<Discovery>,
    homes: Mutex<BTreeMap<RobotId, BTreeSet<Home>>>,
    /// Robots that came (back) and need the approved calibration.
    came: mpsc::Sender<RobotId>,
    /// Earlier messages to query of robots that have announced a description.
    described: mpsc::Sender<String>,
    /// Signal that `homes` changed.
    homes_changed: Notify,
    /// Signal that a robot has announced a topic and needs a subscriber for it.
    announcing: Notify,
    /// Messages sent to ROS 2 robots.
    sent: AtomicI64,
}

/// Locks a mutex. The values behind the locks are whole after every statement, so the panic of
/// another thread leaves nothing half done.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Ros2 {
    /// Locks the table for reading.
    fn table(&self) -> RwLockReadGuard<'_, RouteTable> {
        self.shared
            .table
            .read()
            .unwrap_or_else(PoisonError::into_inner)
    }

    fn change_table<T>(&self, change: impl FnOnce(&mut RouteTable) -> T) -> T {
        let table = self.shared.table.write();
        change(&mut table.unwrap_or_else(PoisonError::into_inner))
    }

    /// Returns the known places of a robot's topics: a robot with two middlewares has two.
    fn homes(&self, robot: &RobotId) -> BTreeSet<Home> {
        let homes = lock(&self.shared.homes);
        homes.get(robot).cloned().unwrap_or_default()
    }

    /// Returns the places of all robots of this process.
    fn all_homes(&self) -> BTreeSet<Home> {
        let homes = lock(&self.shared.homes);
        let own = homes
            .iter()
            .filter(|(robot, _)| self.shared.gate.has(robot));
        own.flat_map(|(_, homes)| homes).cloned().collect()
    }

    /// Records that a robot has announced a topic.
    fn announces(&self, robot: &RobotId) {
        if self.change_table(|table| table.note_announcing(robot)) {
            self.shared.announcing.notify_one();
        }
    }

    /// Forgets the places of a robot's topics, since it no longer announces any.
    fn left(&self, robot: &RobotId) {
        lock(&self.shared.homes).remove(robot);
        self.shared.homes_changed.notify_one();
    }

    /// Records the place of a robot's topics; a robot at a new place receives the approved
    /// calibration.
    fn seen_at(&self, robot: &RobotId, prefix: &str, layout: KeyLayout) {
        if self.moved(robot, prefix, layout) {
            self.came(robot);
        }
    }

    /// Records the place of a robot's topics; returns whether it is new.
    fn moved(&self, robot: &RobotId, prefix: &str, layout: KeyLayout) -> bool {
        if !self.table().knows(robot) {
            // Nothing is approved for a robot that nobody has registered.
            return false;
        }
        let is_there = |home: &Home| home.prefix == prefix && home.layout == layout;
        let homes = lock(&self.shared.homes);
        let is_known = homes.get(robot).is_some_and(|of| of.iter().any(is_there));
        drop(homes);
        if is_known || !calibration::is_home(&self.table(), robot, prefix, layout) {
            return false;
        }
        let mut homes = lock(&self.shared.homes);
        let of_robot = homes.entry(robot.clone()).or_default();
        if of_robot.len() >= limits::ROS2_HOMES_MAX {
            return false;
        }
        let prefix = prefix.to_owned();
        self.shared.homes_changed.notify_one();
        of_robot.insert(Home { prefix, layout })
    }

    /// Queues a robot that came for the approved calibration. It never blocks; a robot that finds
    /// the queue full queries for it itself.
    fn came(&self, robot: &RobotId) {
        if let Err(error) = self.shared.came.try_send(robot.clone()) {
            tracing::debug!(robot.id = %robot, %error, "not told the approved calibration");
        }
    }

    /// Queues the earlier messages of a description to be queried. It never blocks; those that find
    /// the queue full are received when the robot publishes them again.
    fn query_description(&self, expression: String) {
        if let Err(error) = self.shared.described.try_send(expression) {
            tracing::debug!(%error, "a robot's description is not queried");
        }
    }

    /// Makes the attachment of the next message.
    fn attachment(&self, session: &Session) -> Vec<u8> {
        let sequence = self.shared.sent.fetch_add(1, Ordering::Relaxed);
        let now = self.shared.clock.now();
        calibration::attachment(sequence, now.0, &session.zid().to_le_bytes())
    }
}

/// Context of the part of the link that serves ROS 2 robots.
#[derive(Debug)]
pub struct Surroundings {
    /// Fleet of the robots.
    pub fleet: FleetHandle,
    /// Source of the approved calibration.
    pub lifecycle: Lifecycle,
    /// Source of time.
    pub clock: SharedClock,
    /// Queue of the queries.
    pub questions: Questions,
    /// Gate of outgoing messages.
    pub gate: Gate,
    /// Streams, beside their ROS 2 topics, of the robots that an instance of several receives.
    pub heard: Option<HeardStreams>,
}

/// Part of the link that serves ROS 2 robots.
#[derive(Debug)]
pub struct Ros2Link {
    ros2: Ros2,
    /// Subscribers of tokens and of descriptions.
    tokens: Vec<Subscriber<()>>,
    history: Vec<Queryable<()>>,
    tasks: Vec<JoinHandle<()>>,
}

impl Ros2Link {
    /// Subscribes to tokens and streams, and answers queries for the approved calibration.
    ///
    /// # Errors
    /// Zenoh refuses a declaration.
    pub async fn open(
        session: &Session,
        table: RouteTable,
        surroundings: Surroundings,
        stop: CancellationToken,
    ) -> Result<Self> {
        let Surroundings {
            fleet,
            lifecycle,
            clock,
            questions,
            gate,
            heard,
        } = surroundings;
        let publishes = table.settings().publish_calibration;
        let (came, comers) = mpsc::channel(limits::ROBOTS_MAX);
        let (described, announced) = mpsc::channel(limits::DESCRIPTIONS_ASKED_MAX);
        let changes = [fleet.configured(), fleet.heard_changed()];
        let ros2 = Ros2 {
            shared: Arc::new(Shared {
                fleet,
                clock,
                gate,
                table: RwLock::new(table),
                discovery: Mutex::default(),
                homes: Mutex::default(),
                came,
                described,
                homes_changed: Notify::new(),
                announcing: Notify::new(),
                sent: AtomicI64::new(1),
            }),
        };
        let mut hearing = Hearing {
            ros2: ros2.clone(),
            topics: Subscriptions::default(),
            streams: heard,
        };
        hearing.follow(session).await?;
        let mut tokens = description::subscribe(session, &ros2).await?;
        tokens.extend(discovery::watch_tokens(session, &ros2).await?);
        let mut history = Vec::new();
        let asking = description::query(session.clone(), ros2.clone(), announced, stop.clone());
        let mut tasks = vec![tokio::spawn(asking)];
        if publishes {
            let (own, asked) = (ros2.clone(), lifecycle.clone());
            history = calibration::answer_history(session, own, asked, &questions).await?;
            let telling = tell(
                session.clone(),
                ros2.clone(),
                lifecycle,
                comers,
                stop.clone(),
            );
            tasks.push(tokio::spawn(telling));
            let announcing = graph::announce(session.clone(), ros2.clone(), stop.clone());
            tasks.push(tokio::spawn(announcing));
        }
        let following = follow(session.clone(), hearing, changes, stop);
        tasks.push(tokio::spawn(following));
        Ok(Self {
            ros2,
            tokens,
            history,
            tasks,
        })
    }

    /// Returns the state that callbacks share.
    pub fn shared(&self) -> Ros2 {
        self.ros2.clone()
    }

    /// Stops receiving. The tasks have been stopped before.
    pub async fn close(self) {
        for token in self.tokens {
            warn_if_refused(token.undeclare().await);
        }
        for queryable in self.history {
            warn_if_refused(queryable.undeclare().await);
        }
        for task in self.tasks {
            if let Err(error) = task.await {
                tracing::error!(%error, "a task of the link to ROS 2 robots failed");
            }
        }
    }
}

/// Subscriptions to the robots.
#[derive(Debug)]
struct Hearing {
    ros2: Ros2,
    topics: Subscriptions,
    streams: Option<HeardStreams>,
}

impl Hearing {
    /// Subscribes to the wanted keys alone.
    async fn follow(&mut self, session: &Session) -> Result<()> {
        let fleet = &self.ros2.shared.fleet;
        let heard = fleet.heard();
        self.ros2.robots_changed(heard.clone());
        if let (Some(streams), Some(heard)) = (&mut self.streams, &heard) {
            streams.follow(session, heard).await?;
        }
        self.topics.follow(session, &self.ros2).await?;
        if let Some(heard) = heard {
            fleet.set_subscribed(heard);
            self.ros2.shared.homes_changed.notify_one();
        }
        Ok(())
    }
}

impl Hearing {
    /// Declares keys of robots that have begun to send.
    async fn declare_frequent(&mut self, session: &Session) {
        if let Some(streams) = &mut self.streams
            && let Err(error) = streams.declare_frequent(session).await
        {
            tracing::warn!(error, "Zenoh refused to declare a robot's keys");
        }
    }
}

/// Follows the registered and the wanted robots until `stop`.
async fn follow(
    session: Session,
    mut hearing: Hearing,
    changes: [watch::Receiver<u64>; 2],
    stop: CancellationToken,
) {
    let [mut configured, mut heard] = changes;
    let ros2 = hearing.ros2.clone();
    let mut all_stand = true;
    // Both times go on over the turns of the loop: a retry comes after several of them.
    let mut declaring = tokio::time::interval(limits::KEYS_DECLARED_EVERY);
    declaring.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut retry_at = Instant::now();
    loop {
        tokio::select! {
            () = stop.cancelled() => break,
            changed = configured.changed() => if changed.is_err() { break },
            changed = heard.changed() => if changed.is_err() { break },
            () = ros2.shared.announcing.notified() => {}
            () = tokio::time::sleep_until(retry_at), if !all_stand => {}
            _ = declaring.tick(), if hearing.streams.is_some() => {
                hearing.declare_frequent(&session).await;
                continue;
            }
        }
        let followed = hearing.follow(&session).await;
        all_stand = followed.is_ok();
        retry_at = Instant::now() + limits::POST_RETRY;
        if let Err(error) = followed {
            tracing::error!(error, "a robot's topics are not subscribed to");
        }
    }
    hearing.topics.close().await;
    if let Some(streams) = hearing.streams {
        streams.close().await;
    }
}

fn warn_if_refused(undeclared: Result<()>) {
    if let Err(error) = undeclared {
        tracing::warn!(error, "Zenoh refused to undeclare");
    }
}

impl Ros2 {
    /// Reads the robots' topics again, and assigns the announced ones again.
    fn robots_changed(&self, heard: Option<BTreeSet<RobotId>>) {
        let fleet = &self.shared.fleet;
        let mut robots = fleet.streams();
        robots.extend(fleet.previewed_streams());
        self.change_table(|table| {
            table.set_robots(robots);
            table.set_heard(heard);
        });
        discovery::place_anew(self);
    }
}

/// Publishes the approved calibration to robots that came.
async fn tell(
    session: Session,
    ros2: Ros2,
    lifecycle: Lifecycle,
    mut comers: mpsc::Receiver<RobotId>,
    stop: CancellationToken,
) {
    loop {
        let robot = tokio::select! {
            () = stop.cancelled() => return,
            comer = comers.recv() => comer,
        };
        let Some(robot) = robot else {
            return;
        };
        if !ros2.shared.gate.has(&robot) {
            continue;
        }
        match lifecycle.approved(&robot, None).await {
            Ok(Some(offered)) => {
                let put = calibration::publish(&session, &ros2, &robot, &offered).await;
                if let Err(error) = put {
                    tracing::warn!(robot.id = %robot, error, "not told the approved calibration");
                }
            }
            Ok(None) => {}
            Err(error) => {
                tracing::error!(robot.id = %robot, %error, "not told the approved calibration");
            }
        }
    }
}
