//! A cluster with robots, somebody who decides and somebody who listens: what every round is run on.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use fleetcal_contract::own_server::{number, psql};
use fleetcal_store::database_url::PostgresUrl;
use fleetcal_tests::service::{now, wait_for};
use rand::Rng;
use rand::rngs::StdRng;

use crate::checker::Evidence;
use crate::cluster::{Cluster, Instance, Parts};
use crate::decider::{Decider, Desk};
use crate::process::Process;
use crate::records;
use crate::watch::Watch;

/// Names of as many instances as there may be.
const INSTANCES: [&str; 5] = ["a", "b", "c", "d", "e"];
/// Robots that drive.
pub const DRIVING: usize = 6;
/// Robots about which is decided.
pub const PARKED: usize = 2;
/// Robots about which is decided where the database is hurt, each by somebody of their own, and the pause
/// of each between two decisions: more than twenty decisions a second.
pub const DECIDERS: usize = 8;
pub const DECIDERS_PAUSE: Duration = Duration::from_millis(150);
/// So many decisions a second are to be acknowledged before the database is hurt.
pub const DECISIONS_PER_S_MIN: f64 = 20.0;
/// Estimates come once a second: what has not come for so long does not come.
const SETTLED: Duration = Duration::from_millis(2_500);
/// Instances share the robots evenly so long after one joins, leaves, thaws or is reached again.
pub const BALANCED_WITHIN: Duration = Duration::from_secs(30);
/// Between two estimates of a robot that is handed over.
pub const HANDED_OVER_WITHIN: Duration = Duration::from_millis(2_200);
/// Robots of an instance that is gone are estimated again within this time, whatever works.
pub const SERVED_WITHIN: Duration = Duration::from_secs(9);

/// See the module.
#[derive(Debug)]
pub struct Trial {
    /// The instances that run, by name.
    pub instances: BTreeMap<&'static str, Instance>,
    /// What decides.
    pub decider: Decider,
    /// What listens.
    pub watch: Watch,
    /// Where all of it is.
    pub cluster: Cluster,
    robots: Process,
    parked: usize,
    alerts_until: i64,
}

impl Trial {
    /// Starts the instances, and all else. `pause` is that of the decider.
    pub async fn start(fast_takeover: bool, seed: u64, pause: Duration) -> Self {
        let parts = Self::parts(fast_takeover);
        Self::on(Cluster::watched(&parts).await, &parts, seed, pause).await
    }

    /// The parts of a trial's cluster, with as many instances as `CLUSTER_INSTANCES` says.
    pub fn parts(fast_takeover: bool) -> Parts {
        let count = number("CLUSTER_INSTANCES", 2);
        let possible = 2..=INSTANCES.len();
        assert!(
            possible.contains(&count),
            "CLUSTER_INSTANCES: got {count}, expected 2 to 5"
        );
        Parts {
            names: INSTANCES.into_iter().take(count).collect(),
            robots: DRIVING,
            parked: PARKED,
            robots_apply: false,
            fast_takeover,
            in_namespaces: false,
        }
    }

    /// Starts the instances, and all else, on a cluster of these parts.
    pub async fn on(cluster: Cluster, parts: &Parts, seed: u64, pause: Duration) -> Self {
        let names = &parts.names;
        let watch = Watch::start(&cluster.routers).await;
        let instances = names.iter().enumerate();
        let instances =
            instances.map(|(place, &name)| (name, cluster.start(name, router_of(place))));
        let instances: BTreeMap<_, _> = instances.collect();
        // No robot moves after it has begun to drive: a scan matcher's map does not move with it.
        wait_until_even(&instances, DRIVING + parts.parked);
        let robots = cluster.drive();
        // Each decides as somebody of its own: one caller may change no more than one thing a second
        // for long.
        let desks = (1..=parts.parked).map(|robot| desk(&cluster, names, &format!("_{robot}")));
        let decider = Decider::start(desks.collect(), seed, pause);
        let trial = Self {
            instances,
            decider,
            watch,
            cluster,
            robots,
            parked: parts.parked,
            alerts_until: 0,
        };
        trial.owners();
        trial
    }

    /// The database, directly.
    pub fn url(&self) -> PostgresUrl {
        self.cluster.records()
    }

    /// The server's version.
    pub fn server(&self) -> String {
        psql(&self.url(), "SHOW server_version").trim().to_owned()
    }

    /// One of the instances that run.
    pub fn chosen(&self, random: &mut StdRng) -> &'static str {
        let place = random.random_range(0..self.instances.len());
        self.instances.keys().nth(place).unwrap()
    }

    /// Kills an instance; gives when.
    pub fn kill(&mut self, name: &str) -> Instant {
        let mut instance = self.instances.remove(name).unwrap();
        let killed = now();
        instance.process.kill();
        killed
    }

    /// Starts an instance that has ended.
    pub fn start_again(&mut self, name: &'static str) {
        let place = INSTANCES.iter().position(|one| *one == name).unwrap();
        let instance = self.cluster.start(name, router_of(place));
        self.instances.insert(name, instance);
    }

    /// Waits until all instances that run have linked and share the robots evenly; gives how long
    /// that took.
    pub fn balanced(&self) -> Duration {
        let began = now();
        wait_until_even(&self.instances, DRIVING + self.parked);
        began.elapsed()
    }

    /// Waits until every robot's estimates come, each from one instance; gives those instances.
    pub fn owners(&self) -> BTreeMap<String, String> {
        let began = now();
        wait_for("estimates of all robots", || {
            let since = now().checked_sub(SETTLED)?;
            if since < began {
                return None;
            }
            let owners = self.watch.owners(since).into_iter();
            let one = |(robot, of): (String, BTreeSet<String>)| {
                (of.len() == 1).then(|| Some((robot, of.first()?.clone())))?
            };
            let owners: Option<BTreeMap<_, _>> = owners.map(one).collect();
            owners.filter(|owners| owners.len() == DRIVING)
        })
    }

    /// The driving robots of an instance.
    pub fn of_instance(&self, name: &str) -> Vec<String> {
        let owners = self.owners().into_iter();
        let own = owners.filter(|(_, owner)| owner == name);
        own.map(|(robot, _)| robot).collect()
    }

    /// Waits until robots that an instance had come from another one; gives how long after `then`
    /// each did, s.
    pub fn taken_over(&self, then: Instant, from: &str, robots: &[String]) -> Vec<f64> {
        let took = wait_for("a takeover", || self.watch.taken_over(then, from, robots));
        took.iter().map(Duration::as_secs_f64).collect()
    }

    /// How many decisions a second are acknowledged, over this time.
    pub fn decisions_per_s(&self, over: Duration) -> f64 {
        let (began, before) = (now(), self.decider.acknowledged());
        std::thread::sleep(over);
        (self.decider.acknowledged() - before) as f64 / began.elapsed().as_secs_f64()
    }

    /// Alerts that were raised since the last question.
    pub fn alerts(&mut self) -> Vec<String> {
        let (raised, until) = records::alerts_after(&self.url(), self.alerts_until);
        self.alerts_until = until;
        raised
    }

    /// All that was seen so far.
    pub fn evidence(&self) -> Evidence {
        // Decisions first: what is acknowledged by now is in the rows that are read afterwards.
        let mut evidence = Evidence {
            decisions: self.decider.decisions(),
            ..Evidence::default()
        };
        records::read(&self.url(), &mut evidence);
        self.watch.read(&mut evidence);
        evidence
    }

    /// Asserts that nothing is wrong so far; gives how many estimates came late.
    pub fn check(&self, round: u64) -> usize {
        let evidence = self.evidence();
        assert!(!evidence.written.is_empty(), "nobody wrote anything");
        assert!(!evidence.owners.is_empty(), "nobody had a robot");
        let wrong = evidence.violations();
        assert!(
            wrong.is_empty(),
            "round {round}: {wrong:#?}; refused last: {:?}",
            self.decider.refusals()
        );
        evidence.stale_estimates().into_values().sum()
    }

    /// What a campaign was watched by.
    pub fn seen(&self) -> String {
        let evidence = self.evidence();
        let acknowledged = self.decider.acknowledged();
        format!(
            "checked: {acknowledged} acknowledged of {} decisions, {} audit rows, {} telemetry rows, \
             {} changes of owner, {} estimates, {} documents",
            evidence.decisions.len(),
            evidence.audit.len(),
            evidence.written.len(),
            evidence.owners.len(),
            evidence.estimates.len(),
            evidence.documents.len()
        )
    }

    /// Stops the robots, then the instances one after the other, in order; gives the cluster.
    pub fn end(mut self) -> Cluster {
        self.robots.signal("TERM");
        self.robots.ended();
        std::thread::sleep(SETTLED);
        for instance in self.instances.values_mut() {
            instance.process.end_in_order();
        }
        self.cluster
    }

    /// Whether the robots drive on.
    pub fn drives(&self) -> bool {
        !self.robots.said().contains("panicked")
    }
}

/// The router of the instance at a place: one of two, in turn.
fn router_of(place: usize) -> usize {
    place % 2
}

/// Waits until instances share so many robots evenly, as each of them sees it.
fn wait_until_even(instances: &BTreeMap<&'static str, Instance>, robots: usize) {
    let is_even = |seen_by: &Instance| {
        let shares = seen_by.shares()?;
        let (least, most) = (shares.values().min()?, shares.values().max()?);
        let all: u64 = shares.values().sum();
        Some(most - least <= 1 && all == robots as u64 && shares.len() == instances.len())
    };
    wait_for("even shares", || {
        let mut seen = instances.values().map(is_even);
        seen.all(|even| even == Some(true)).then_some(())
    });
}

/// Whether a robot only has decisions made about it.
pub fn is_parked(robot: &str) -> bool {
    robot.starts_with("parked_")
}

/// Asserts that enough was decided a second for a round to count.
pub fn assert_rate(per_s: f64) {
    assert!(
        per_s >= DECISIONS_PER_S_MIN,
        "{per_s:.1} decisions a second"
    );
}

/// Where is decided, and by whom, whose names end so.
pub fn desk(cluster: &Cluster, names: &[&str], end: &str) -> Desk {
    Desk {
        instances: names.iter().map(|name| cluster.http(name)).collect(),
        proposer: cluster.token_of(&format!("carla{end}")),
        approver: cluster.token_of(&format!("ana{end}")),
    }
}
