//! Metrics of the instances of a cluster, as the instance that answers knows them.

use std::collections::BTreeMap;
use std::fmt;

use fleetcal_cluster::{Epoch, InstanceId, Member, Membership, Snapshot, homeless};
use prometheus_client::encoding::{DescriptorEncoder, EncodeMetric};
use prometheus_client::metrics::MetricType;
use prometheus_client::metrics::gauge::ConstGauge;

use crate::{counter, gauge};

/// Writes the families of a cluster; a service that is alone has none.
///
/// # Errors
/// The text cannot be written.
pub fn encode(out: &mut DescriptorEncoder<'_>, membership: &Membership) -> fmt::Result {
    let Some(cluster) = membership.cluster() else {
        return Ok(());
    };
    let snapshot = cluster.snapshot();
    let live = snapshot.members.iter().filter(|member| member.is_live());
    let help = "Instances whose lease has not ended";
    gauge(out, "fleetcal_cluster_instances", help, live.count() as f64)?;
    of_instances(out, &snapshot)?;
    let epochs = snapshot.robots.values().map(|row| row.epoch);
    let Epoch(epoch) = epochs.max().unwrap_or_default();
    let help = "The highest epoch of a robot, which goes up with each takeover and move of one";
    gauge(out, "fleetcal_cluster_epoch", help, epoch as f64)?;
    let without = homeless(&snapshot).count();
    let help = "Robots that no instance has";
    gauge(
        out,
        "fleetcal_cluster_robots_without_instance",
        help,
        without as f64,
    )?;
    let help = "Lost instances whose robots and duties this one has freed";
    counter(out, "fleetcal_cluster_takeovers", help, cluster.takeovers())
}

/// Name, meaning and value of an instance's gauge.
type InstanceGauge = (&'static str, &'static str, fn(&Member) -> f64);

const GAUGES: [InstanceGauge; 2] = [
    (
        "fleetcal_cluster_lease_left_seconds",
        "Time until the lease of an instance ends unless it is renewed",
        |member| member.lease_left.as_secs_f64(),
    ),
    (
        "fleetcal_cluster_clock_ahead_seconds",
        "By how much the clock of an instance is ahead of the database's",
        |member| member.clock_ahead_ns as f64 / 1e9,
    ),
];

fn of_instances(out: &mut DescriptorEncoder<'_>, snapshot: &Snapshot) -> fmt::Result {
    let mut robots: BTreeMap<&InstanceId, usize> = BTreeMap::new();
    for member in &snapshot.members {
        robots.entry(&member.seat.instance).or_default();
    }
    for owner in snapshot
        .robots
        .values()
        .filter_map(|row| row.owner.as_ref())
    {
        *robots.entry(&owner.instance).or_default() += 1;
    }
    let values = robots.iter().map(|(name, count)| (*name, *count as f64));
    let help = "Robots that an instance estimates";
    by_instance(out, "fleetcal_cluster_robots", help, values)?;
    for (name, help, value) in GAUGES {
        let members = snapshot.members.iter();
        let values = members.map(|member| (&member.seat.instance, value(member)));
        by_instance(out, name, help, values)?;
    }
    Ok(())
}

/// Writes a family of gauges by instance. The label is not `instance`, which Prometheus sets to the
/// scraped target.
fn by_instance<'a>(
    out: &mut DescriptorEncoder<'_>,
    name: &str,
    help: &str,
    values: impl Iterator<Item = (&'a InstanceId, f64)>,
) -> fmt::Result {
    let mut family = out.encode_descriptor(name, help, None, MetricType::Gauge)?;
    for (instance, value) in values {
        let labels = [("member", instance.as_str())];
        ConstGauge::new(value).encode(family.encode_family(&labels)?)?;
    }
    Ok(())
}
