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

/// Names of all possible instances.
const INSTANCES: [&str; 5] = ["a", "b", "c", "d", "e"];
/// Driving robots.
pub const DRIVING: usize = 6;
/// Robots with decisions.
pub const PARKED: usize = 2;
/// Robots with decisions where the database is disturbed, each with a decider of its own, with a
/// pause between two decisions that makes more than twenty a second in all.
pub const DECIDERS: usize = 8;
pub const DECIDERS_PAUSE: Duration = Duration::from_millis(150);
/// Least rate of acknowledged decisions before the database is disturbed, 1/s.
pub const DECISIONS_PER_S_MIN: f64 = 20.0;
/// Time after which missing estimates, one a second, never come.
const SETTLED: Duration = Duration::from_millis(2_500);
/// Time within which instances share the robots evenly after one joins, leaves, is resumed or is
/// reached again.
pub const BALANCED_WITHIN: Duration = Duration::from_secs(30);
/// Longest time between two estimates of a robot that is handed over.
pub const HANDED_OVER_WITHIN: Duration = Duration::from_millis(2_200);
/// Time within which robots of a lost instance are estimated again, in any case.
pub const SERVED_WITHIN: Duration = Duration::from_secs(9);

/// Cluster with robots, a decider and a listener; see the module.
#[derive(Debug)]
pub struct Trial {
    /// Running instances, by name.
    pub instances: BTreeMap<&'static str, Instance>,
    /// Decider.
    pub decider: Decider,
    /// Listener.
    pub watch: Watch,
    /// Cluster that all of it runs on.
    pub cluster: Cluster,
    robots: Process,
    parked: usize,
    alerts_until: i64,
}

impl Trial {
    /// Starts the instances, and the rest. `pause` is that of the decider.
    pub async fn start(fast_takeover: bool, seed: u64, pause: Duration) -> Self {
        let parts = Self::parts(fast_takeover);
        Self::on(Cluster::watched(&parts).await, &parts, seed, pause).await
    }

    /// Returns the parts of a trial's cluster, with `CLUSTER_INSTANCES` instances.
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

    /// Starts the instances, and the rest, on a cluster of these parts.
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

    /// Returns the database, without a proxy.
    pub fn url(&self) -> PostgresUrl {
        self.cluster.records()
    }

    /// Returns the server's version.
    pub fn server(&self) -> String {
        psql(&self.url(), "SHOW server_version").trim().to_owned()
    }

    /// Draws one of the running instances.
    pub fn chosen(&self, random: &mut StdRng) -> &'static str {
        let place = random.random_range(0..self.instances.len());
        self.instances.keys().nth(place).unwrap()
    }

    /// Kills an instance; returns the time.
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

    /// Waits until all running instances have linked and share the robots evenly; returns the time
    /// that took.
    pub fn balanced(&self) -> Duration {
        let began = now();
        wait_until_even(&self.instances, DRIVING + self.parked);
        began.elapsed()
    }

    /// Waits until every robot's estimates come, each from one instance; returns those instances.
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

    /// Returns the driving robots of an instance.
    pub fn of_instance(&self, name: &str) -> Vec<String> {
        let owners = self.owners().into_iter();
        let own = owners.filter(|(_, owner)| owner == name);
        own.map(|(robot, _)| robot).collect()
    }

    /// Waits until the robots of an instance come from another one; returns the time from `then` on
    /// for each, s.
    pub fn taken_over(&self, then: Instant, from: &str, robots: &[String]) -> Vec<f64> {
        let took = wait_for("a takeover", || self.watch.taken_over(then, from, robots));
        took.iter().map(Duration::as_secs_f64).collect()
    }

    /// Measures the rate of acknowledged decisions over this time, 1/s.
    pub fn decisions_per_s(&self, over: Duration) -> f64 {
        let (began, before) = (now(), self.decider.acknowledged());
        std::thread::sleep(over);
        (self.decider.acknowledged() - before) as f64 / began.elapsed().as_secs_f64()
    }

    /// Returns the alerts raised since the last call.
    pub fn alerts(&mut self) -> Vec<String> {
        let (raised, until) = records::alerts_after(&self.url(), self.alerts_until);
        self.alerts_until = until;
        raised
    }

    /// Returns the evidence so far.
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

    /// Asserts that there are no violations so far; returns the number of late estimates.
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

    /// Formats the observations of a campaign.
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

    /// Stops the robots, then the instances one after the other, in order; returns the cluster.
    pub fn end(mut self) -> Cluster {
        self.robots.signal("TERM");
        self.robots.ended();
        std::thread::sleep(SETTLED);
        for instance in self.instances.values_mut() {
            instance.process.end_in_order();
        }
        self.cluster
    }

    /// True if the robots still drive.
    pub fn drives(&self) -> bool {
        !self.robots.said().contains("panicked")
    }
}

/// Returns the router of the instance at a place: one of two, in turn.
fn router_of(place: usize) -> usize {
    place % 2
}

/// Waits until instances share this number of robots evenly, in the view of each of them.
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

/// True if a robot only has decisions made about it.
pub fn is_parked(robot: &str) -> bool {
    robot.starts_with("parked_")
}

/// Asserts that the rate of decisions suffices for a round to count.
pub fn assert_rate(per_s: f64) {
    assert!(
        per_s >= DECISIONS_PER_S_MIN,
        "{per_s:.1} decisions a second"
    );
}

/// Makes a desk whose users have names with this ending.
pub fn desk(cluster: &Cluster, names: &[&str], end: &str) -> Desk {
    Desk {
        instances: names.iter().map(|name| cluster.http(name)).collect(),
        proposer: cluster.token_of(&format!("carla{end}")),
        approver: cluster.token_of(&format!("ana{end}")),
    }
}
