//! Documents of the instances of a cluster.

use std::collections::BTreeMap;

use fleetcal_cluster::{
    Cluster, Duty, Epoch, InstanceId, Member, Membership, Seat, Snapshot, Takeover, homeless,
};
use fleetcal_domain::limits;
use fleetcal_model::WallTime;
use fleetcal_proto::RobotId;
use jiff::Timestamp;
use serde::Serialize;

use crate::time;

/// The instances that share a fleet.
#[derive(Debug, Default, Serialize, utoipa::ToSchema)]
#[schema(as = Cluster)]
pub(crate) struct ClusterDocument {
    /// Whether one service has all robots, so that there are no instances.
    alone: bool,
    /// The instance that answers; absent of a service that is alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    instance: Option<String>,
    /// When it read what it says here, by the database's clock; absent before the first time.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>, format = DateTime)]
    read: Option<Timestamp>,
    /// All instances, by name.
    instances: Vec<InstanceDocument>,
    /// What one instance does for all.
    duties: Vec<DutyDocument>,
    /// How many robots no instance has at this moment.
    robots_without_instance: usize,
    /// Those robots, the first 100.
    without_instance: Vec<RobotId>,
    /// What the instance that answers took over last; absent when that was nothing since its start.
    #[serde(skip_serializing_if = "Option::is_none")]
    last_takeover: Option<TakeoverDocument>,
}

/// An instance of a cluster.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Instance)]
struct InstanceDocument {
    /// Its name.
    name: String,
    /// Where other instances reach it.
    url: String,
    /// Version of its program.
    program: String,
    /// How many robots it estimates.
    robots: usize,
    /// The highest epoch of these; absent while it has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    epoch_max: Option<i64>,
    /// Its weight against others.
    capacity: u32,
    /// Time until its lease ends unless it is renewed, s; 0 once it has ended.
    lease_left_s: f64,
    /// Whether it reaches a Zenoh router, and its clock is right enough.
    linked: bool,
    /// Other instances that it does not hear over Zenoh: the routers between them are cut.
    unheard: Vec<String>,
    /// Whether it gives its robots away, because it is about to end.
    draining: bool,
    /// By how much its clock is ahead of the database's, s.
    clock_ahead_s: f64,
    /// When it joined.
    #[schema(value_type = String, format = DateTime)]
    joined: Timestamp,
    /// Whether its configuration is another than that of the instance that answers.
    config_differs: bool,
}

/// Something that one instance does for all.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = ClusterDuty)]
struct DutyDocument {
    /// What: `alerts`, `webhooks`, `retention` or `discovery`.
    duty: &'static str,
    /// Who; null while nobody does.
    instance: Option<String>,
}

/// That an instance took over what another one had.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Takeover)]
struct TakeoverDocument {
    /// Who had it.
    from: String,
    /// Who found it lost.
    by: String,
    /// When.
    #[schema(value_type = String, format = DateTime)]
    at: Timestamp,
    /// How many robots became free by it.
    robots: usize,
}

impl ClusterDocument {
    /// The document of what a process knows of its cluster.
    pub(super) fn of(membership: &Membership) -> Self {
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
