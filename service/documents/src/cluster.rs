//! Documents of the instances of a cluster.

use std::collections::BTreeMap;

use fleetcal_cluster::{
    Cluster, Duty, Epoch, InstanceId, Member, Membership, Seat, Snapshot, Takeover, homeless,
};
use fleetcal_domain::limits;
use fleetcal_domain::timestamp as time;
use fleetcal_model::WallTime;
use fleetcal_proto::RobotId;
use jiff::Timestamp;
use serde::Serialize;

/// Cluster of instances that share a fleet.
#[derive(Debug, Default, Serialize, utoipa::ToSchema)]
#[schema(as = Cluster)]
pub struct ClusterDocument {
    /// True if a single service has all robots, so that there are no instances.
    alone: bool,
    /// Instance that answers; absent for a single service.
    #[serde(skip_serializing_if = "Option::is_none")]
    instance: Option<String>,
    /// Time at which it read this, by the database's clock; absent before the first time.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>, format = DateTime)]
    read: Option<Timestamp>,
    /// Instances of the cluster, by name.
    instances: Vec<InstanceDocument>,
    /// Duties that one instance performs for all.
    duties: Vec<DutyDocument>,
    /// Number of robots without an instance at this moment.
    robots_without_instance: usize,
    /// Robots without an instance, the first 100.
    without_instance: Vec<RobotId>,
    /// Last takeover by the instance that answers; absent if there was none since its start.
    #[serde(skip_serializing_if = "Option::is_none")]
    last_takeover: Option<TakeoverDocument>,
}

/// Instance of a cluster.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Instance)]
struct InstanceDocument {
    /// Name of the instance.
    name: String,
    /// Address for other instances.
    url: String,
    /// Version of its program.
    program: String,
    /// Number of robots that it estimates.
    robots: usize,
    /// Highest epoch of its robots; absent while it has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    epoch_max: Option<i64>,
    /// Weight in the distribution of robots.
    capacity: u32,
    /// Time until its lease ends unless it is renewed, s; 0 once it has ended.
    lease_left_s: f64,
    /// True if it is connected to a Zenoh router, and its clock is accurate enough.
    linked: bool,
    /// Other instances that it does not receive over Zenoh: the routers between them are
    /// disconnected.
    unheard: Vec<String>,
    /// True if it hands its robots over, because it is about to end.
    draining: bool,
    /// Lead of its clock over the database's, s.
    clock_ahead_s: f64,
    /// Time at which it joined.
    #[schema(value_type = String, format = DateTime)]
    joined: Timestamp,
    /// True if its configuration differs from the answering instance's.
    config_differs: bool,
}

/// Duty that one instance performs for all.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = ClusterDuty)]
struct DutyDocument {
    /// Name of the duty: `alerts`, `webhooks`, `retention` or `discovery`.
    duty: &'static str,
    /// Instance that performs it; null without one.
    instance: Option<String>,
}

/// Takeover of an instance's robots and duties.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Takeover)]
struct TakeoverDocument {
    /// Former owner.
    from: String,
    /// Instance that declared it dead.
    by: String,
    /// Time of the takeover.
    #[schema(value_type = String, format = DateTime)]
    at: Timestamp,
    /// Number of robots that became free.
    robots: usize,
}

impl ClusterDocument {
    /// Document of a process's cluster.
    pub fn of(membership: &Membership) -> Self {
        match membership.cluster() {
            Some(cluster) => Self::of_cluster(cluster),
            None => Self {
                alone: true,
                ..Self::default()
            },
        }
    }

    fn of_cluster(cluster: &Cluster) -> Self {
        let snapshot = cluster.snapshot();
        let without: Vec<_> = homeless(&snapshot)
            .map(|(robot, _)| robot.clone())
            .collect();
        let is_read = snapshot.now != WallTime::default();
        Self {
            alone: false,
            instance: Some(name(cluster.instance())),
            read: is_read.then(|| time::of(snapshot.now)),
            instances: instances(cluster, &snapshot),
            duties: Duty::ALL
                .iter()
                .map(|duty| DutyDocument::of(*duty, &snapshot))
                .collect(),
            robots_without_instance: without.len(),
            without_instance: without
                .into_iter()
                .take(limits::CLUSTER_ROBOTS_TOLD_MAX)
                .collect(),
            last_takeover: cluster
                .last_takeover()
                .map(|last| TakeoverDocument::of(&last, cluster.instance())),
        }
    }
}

fn instances(cluster: &Cluster, snapshot: &Snapshot) -> Vec<InstanceDocument> {
    let mut owned: BTreeMap<&Seat, (usize, Epoch)> = BTreeMap::new();
    for row in snapshot.robots.values() {
        if let Some(owner) = &row.owner {
            let (robots, epoch_max) = owned.entry(owner).or_default();
            *robots += 1;
            *epoch_max = row.epoch.max(*epoch_max);
        }
    }
    let seat = cluster.seat();
    let own = seat.and_then(|seat| snapshot.member(&seat));
    let members = snapshot.members.iter();
    let documents = members.map(|member| {
        let owned = owned.get(&member.seat).copied();
        let differs = own.is_some_and(|own| own.config_sha256 != member.config_sha256);
        InstanceDocument::of(member, owned, differs)
    });
    let mut documents: Vec<_> = documents.collect();
    documents.sort_by(|a, b| a.name.cmp(&b.name));
    documents
}

impl InstanceDocument {
    fn of(member: &Member, owned: Option<(usize, Epoch)>, config_differs: bool) -> Self {
        Self {
            name: name(&member.seat.instance),
            url: member.url.clone(),
            program: member.program.clone(),
            robots: owned.map_or(0, |(robots, _)| robots),
            epoch_max: owned.map(|(_, Epoch(epoch))| epoch),
            capacity: member.capacity,
            lease_left_s: member.lease_left.as_secs_f64(),
            linked: member.linked,
            unheard: member.hearing.unheard_instances.iter().map(name).collect(),
            draining: member.draining,
            clock_ahead_s: member.clock_ahead_ns as f64 / 1e9,
            joined: time::of(WallTime(member.joined_ns)),
            config_differs,
        }
    }
}

impl DutyDocument {
    fn of(duty: Duty, snapshot: &Snapshot) -> Self {
        let row = snapshot.duties.get(&duty);
        let owner = row.and_then(|row| row.owner.as_ref());
        Self {
            duty: duty.name(),
            instance: owner.map(|seat| name(&seat.instance)),
        }
    }
}

impl TakeoverDocument {
    fn of(takeover: &Takeover, by: &InstanceId) -> Self {
        Self {
            from: name(&takeover.from),
            by: name(by),
            at: time::of(takeover.at),
            robots: takeover.robots,
        }
    }
}

fn name(instance: &InstanceId) -> String {
    instance.as_str().to_owned()
}
