//! Rules, each of which detects one kind of problem of one robot.

use fleetcal_model::{Parameter, ParameterStatus, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::{AppliedStatus, CalibrationValues};
use fleetcal_proto::estimate::EstimateDocument;

use super::condition::Observation;
use super::kind::AlertKind;
use super::policy::AlertPolicy;
use super::subject::Subject;
use crate::approval::{
    self, Contradicted, Deployment, DeploymentState, RobotLedger, difference, nominal_values,
};
use crate::robot::{RobotState, RobotView, WarningKind};
use crate::timestamp;

/// Nanoseconds in a second.
const NS_PER_S: i64 = 1_000_000_000;
/// Time for a robot that was heard before the service's start to be heard again, s.
const STALE_S: i64 = 3;
/// Time for which a fault counts as going on after the estimator reported it.
const FAULT_LASTS_NS: i64 = 5 * NS_PER_S;

/// State of a robot beside its records.
#[derive(Debug, Clone, Copy)]
pub struct Situation<'a> {
    /// Wall time.
    pub now: WallTime,
    /// Begin of the watch, wall time.
    pub watched_since_ns: WallTime,
    /// The robot.
    pub view: &'a RobotView,
    /// True if what the robot's instance publishes arrives here; otherwise the view is old.
    pub in_sight: bool,
    /// Records of the robot.
    pub ledger: &'a RobotLedger,
    /// Newest deployment, under way or not.
    pub latest: Option<&'a Deployment>,
    /// Time and source of the last fault that its estimator reported, wall time.
    pub fault: Option<(WallTime, &'a str)>,
    /// Limits of deviations.
    pub approval: &'a approval::Policy,
    /// Policy of alerts.
    pub policy: &'a AlertPolicy,
}

/// Sighting of one rule.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sighting {
    /// Kind of the rule.
    pub kind: AlertKind,
    /// Observation of the rule.
    pub observation: Observation,
    /// Description, if it fires.
    pub what: String,
    /// Robots of a sighting about several.
    pub robots: Vec<RobotId>,
}

impl Sighting {
    fn of(kind: AlertKind, seen: Seen) -> Self {
        let (observation, what) = match seen {
            Seen::Firing(what) => (Observation::Firing, what),
            Seen::Clear => (Observation::Clear, String::new()),
            Seen::Unknown => (Observation::Unknown, String::new()),
        };
        Self {
            kind,
            observation,
            what,
            robots: Vec::new(),
        }
    }
}

enum Seen {
    Firing(String),
    Clear,
    Unknown,
}

impl Seen {
    fn firing_if(wrong: bool, what: impl FnOnce() -> String) -> Self {
        if wrong {
            Self::Firing(what())
        } else {
            Self::Clear
        }
    }
}

/// Sightings of every rule of [`AlertKind::OF_ROBOT`] for a robot. A robot without a configured
/// vehicle, and a retired one, has no problem.
pub fn sightings(situation: &Situation<'_>) -> [Sighting; AlertKind::OF_ROBOT.len()] {
    AlertKind::OF_ROBOT.map(|kind| {
        let off = situation.policy.off.contains(&kind)
            || situation.view.config.is_none()
            || situation.ledger.shadow.retired.is_some();
        let seen = if off {
            Seen::Clear
        } else if !situation.in_sight && !kind.reads_records_alone() {
            Seen::Unknown
        } else {
            look(kind, situation)
        };
        Sighting::of(kind, seen)
    })
}

/// Sighting of [`AlertKind::SessionsFull`] for the fleet; `crowded` describes the places of Zenoh
/// sessions while they are taken.
pub fn sessions_full(crowded: Option<String>, policy: &AlertPolicy) -> (Subject, Sighting) {
    let kind = AlertKind::SessionsFull;
    let crowded = crowded.filter(|_| !policy.off.contains(&kind));
    let seen = crowded.map_or(Seen::Clear, Seen::Firing);
    (Subject::Fleet, Sighting::of(kind, seen))
}

fn look(kind: AlertKind, situation: &Situation<'_>) -> Seen {
    match kind {
        AlertKind::RollbackFailed => rollback_failed(situation),
        AlertKind::Drift => drift(situation),
        AlertKind::Uncalibrated => uncalibrated(situation),
        AlertKind::VerificationFailed => verification_failed(situation),
        AlertKind::TwoSenders => two_senders(situation),
        AlertKind::FormerKey => former_key(situation),
        AlertKind::FalseReport => false_report(situation),
        AlertKind::EstimatorFailed => {
            let view = situation.view;
            Seen::firing_if(view.state == RobotState::Failed, || {
                let restarts = view.estimator_restarts;
                format!("the estimator failed, was restarted {restarts} times, and was stopped")
            })
        }
        AlertKind::NotApplied => not_applied(situation),
        AlertKind::OutOfSync => out_of_sync(situation),
        AlertKind::NoData => no_data(situation),
        AlertKind::Fault => fault(situation),
        // The rows of the cluster and the link say these.
        AlertKind::NoInstance
        | AlertKind::RoutersCut
        | AlertKind::ConfigurationsDiffer
        | AlertKind::ClockOff
        | AlertKind::SessionsFull => Seen::Unknown,
    }
}

/// A cause that a check names is said instead of the fault that it leads to.
fn fault(situation: &Situation<'_>) -> Seen {
    if let Some(finding) = situation.view.checks.wrong() {
        return Seen::Firing(finding.in_words());
    }
    match situation.fault {
        Some((at_ns, cause)) => {
            let since_ns = situation.now.ns_since(at_ns);
            let lasts = (0..FAULT_LASTS_NS).contains(&since_ns);
            Seen::firing_if(lasts, || {
                format!("the estimator reported a fault of the {cause}")
            })
        }
        None => Seen::Clear,
    }
}

fn rollback_failed(situation: &Situation<'_>) -> Seen {
    let shadow = &situation.ledger.shadow;
    let failed = situation
        .latest
        .filter(|latest| latest.state == DeploymentState::RollbackFailed && !shadow.in_sync());
    match failed {
        Some(latest) => Seen::Firing(format!(
            "deployment {} was rolled back and the robot did not take its former values: {}",
            latest.id,
            reason_of(latest)
        )),
        None => Seen::Clear,
    }
}

fn verification_failed(situation: &Situation<'_>) -> Seen {
    use DeploymentState as S;
    let failed = situation.latest.filter(|latest| {
        let verdict = latest.verification.as_ref();
        let disagrees = verdict.is_some_and(|verdict| !verdict.within);
        disagrees
            && matches!(
                latest.state,
                S::Verifying | S::RollingBack | S::RolledBack | S::Kept
            )
    });
    let Some(latest) = failed else {
        return Seen::Clear;
    };
    // While it still verifies, people decide on that verdict, not on the present estimate.
    let is_settled = matches!(latest.state, S::RolledBack | S::Kept);
    let is_settled = is_settled && situation.ledger.shadow.in_sync();
    if is_settled && matches!(compared(situation), Compared::Near) {
        return Seen::Clear;
    }
    let follows = match latest.state {
        S::RolledBack => "the robot uses its former values again".to_owned(),
        S::RollingBack => "its former values are on their way to the robot".to_owned(),
        S::Kept => format!(
            "the robot keeps the values that {} chose",
            latest.approved_by
        ),
        _ => "the robot still uses it".to_owned(),
    };
    let limits = situation.approval.verify_within.limits();
    let verdict = latest.verification.as_ref();
    let residual = verdict.map(|verdict| verdict.residual);
    let parts = residual.map(|residual| far_parts(&residual, None, &limits));
    Seen::Firing(format!(
        "deployment {} failed its verification ({}); {follows}",
        latest.id,
        parts.unwrap_or_default()
    ))
}

fn two_senders(situation: &Situation<'_>) -> Seen {
    Seen::firing_if(situation.view.is_warned(WarningKind::TwoSenders), || {
        "two senders use the robot's id at once; nothing that they send is used".to_owned()
    })
}

fn former_key(situation: &Situation<'_>) -> Seen {
    Seen::firing_if(situation.view.is_warned(WarningKind::FormerKey), || {
        "the robot sends its wheel odometry on the former key, and it is not used".to_owned()
    })
}

fn false_report(situation: &Situation<'_>) -> Seen {
    match &situation.ledger.shadow.contradicted {
        Some(one) => Seen::Firing(contradiction(one)),
        None => Seen::Clear,
    }
}

fn contradiction(one: &Contradicted) -> String {
    let first = match one.status {
        AppliedStatus::Applied | AppliedStatus::Reverted => "uses",
        AppliedStatus::Refused | AppliedStatus::Failed => "did not take",
    };
    format!(
        "an answer said that the robot {first} generation {}, and a later one about generation {} \
         contradicts it: one of them was not the robot's",
        one.generation, one.by_generation
    )
}

fn not_applied(situation: &Situation<'_>) -> Seen {
    use DeploymentState as S;
    let Some(latest) = situation.latest else {
        return Seen::Clear;
    };
    // What it uses, although that was given up, it did apply: that is another alert.
    if situation.ledger.shadow.uses(latest.offer.generation) {
        return Seen::Clear;
    }
    let outcome = match latest.state {
        S::Refused => "was refused by the robot",
        S::Failed => "was not kept by the robot",
        S::TimedOut => "was not taken by the robot in time",
        _ => return Seen::Clear,
    };
    let (id, reason) = (latest.id, reason_of(latest));
    Seen::Firing(format!("deployment {id} {outcome}: {reason}"))
}

fn reason_of(deployment: &Deployment) -> &str {
    deployment
        .reason
        .as_deref()
        .unwrap_or("no reason was given")
}

fn out_of_sync(situation: &Situation<'_>) -> Seen {
    let ledger = situation.ledger;
    let told_otherwise = situation
        .latest
        .is_some_and(|latest| latest.state == DeploymentState::RollbackFailed);
    if ledger.live.is_some() || told_otherwise {
        return Seen::Clear;
    }
    let shadow = &ledger.shadow;
    if let Some(unwanted) = shadow.unwanted() {
        return Seen::Firing(format!(
            "the robot uses generation {unwanted} and should use none: it was taken back, or was \
             never approved here"
        ));
    }
    let Some(desired) = &shadow.desired else {
        return Seen::Clear;
    };
    Seen::firing_if(!shadow.in_sync(), || {
        let should = desired.generation;
        match &shadow.in_use {
            Some(in_use) => format!(
                "the robot should use generation {should} and uses {}",
                in_use.generation
            ),
            None => format!("the robot should use generation {should} and has not said that"),
        }
    })
}

/// Silence of a robot that was sending before or after the service's start. A robot in maintenance
/// is expected to be silent.
fn no_data(situation: &Situation<'_>) -> Seen {
    let connection = &situation.view.connection;
    let maintenance = situation.ledger.shadow.maintenance.as_ref();
    if maintenance.is_some_and(|one| one.holds_at(situation.now)) {
        return Seen::Clear;
    }
    let Some(last_heard) = connection.last_heard() else {
        return Seen::Unknown;
    };
    let watched_ns = situation.now.ns_since(situation.watched_since_ns);
    let is_expected = connection.last_seen_ns.is_some() || watched_ns >= NS_PER_S * STALE_S;
    Seen::firing_if(connection.stale && is_expected, || {
        let seen = timestamp::of(last_heard);
        format!("nothing has come from the robot since {seen:.0}")
    })
}

/// Steering offset, LiDAR x, y and yaw, in the order of [`approval::Change`].
const FOUR: [Parameter; 4] = [
    Parameter::SteeringOffset,
    Parameter::LidarX,
    Parameter::LidarY,
    Parameter::LidarYaw,
];

fn drift(situation: &Situation<'_>) -> Seen {
    let view = situation.view;
    if is_silent(situation) || matches!(view.state, RobotState::NoData | RobotState::Failed) {
        return Seen::Unknown;
    }
    let changed = view.state == RobotState::Changed;
    match (compared(situation), changed) {
        (Compared::Far(parts), false) if situation.ledger.uses_approved() => {
            Seen::Firing(parts_away(&parts))
        }
        (Compared::Far(parts), true) => Seen::Firing(format!(
            "the vehicle is no longer the one that was calibrated: {parts} away from what the \
             robot uses"
        )),
        (Compared::Near | Compared::NotYet, true) => Seen::Firing(
            "the vehicle is no longer the one that was calibrated; how far it moved is being \
             learnt"
                .to_owned(),
        ),
        // What no estimate was approved for cannot have drifted.
        (Compared::Near | Compared::Far(_), false) => Seen::Clear,
        (Compared::NotYet, false) => Seen::Unknown,
    }
}

/// Compares the estimate with values of the factory or of a return that a person ordered.
fn uncalibrated(situation: &Situation<'_>) -> Seen {
    let view = situation.view;
    if situation.ledger.uses_approved() || view.state == RobotState::Changed {
        return Seen::Clear;
    }
    if is_silent(situation) || matches!(view.state, RobotState::NoData | RobotState::Failed) {
        return Seen::Unknown;
    }
    match compared(situation) {
        Compared::Far(parts) => Seen::Firing(parts_away(&parts)),
        Compared::Near => Seen::Clear,
        Compared::NotYet => Seen::Unknown,
    }
}

fn parts_away(parts: &str) -> String {
    format!("{parts} away from what the robot uses")
}

/// True if the robot has sent nothing for so long that its estimate is out of date. Gaps of
/// seconds, as of a radio link, do not count.
fn is_silent(situation: &Situation<'_>) -> bool {
    let connection = &situation.view.connection;
    let pending_ns = situation.policy.periods(AlertKind::Drift).pending_ns;
    let quiet_ns = connection
        .last_seen_ns
        .map(|seen_ns| situation.now.ns_since(seen_ns));
    connection.stale && quiet_ns.is_none_or(|quiet_ns| quiet_ns >= pending_ns)
}

enum Compared {
    /// Parameters that are significantly too far away, described.
    Far(String),
    /// All four parameters known, and within their limits.
    Near,
    /// Known parameters within their limits, and some unknown.
    NotYet,
}

/// Compares the present estimate with the values in use.
fn compared(situation: &Situation<'_>) -> Compared {
    let view = situation.view;
    let nominal = view
        .config
        .as_ref()
        .and_then(|config| config.nominal_extrinsics);
    let in_use = situation.ledger.shadow.in_use.as_ref();
    let used = in_use
        .map(|in_use| in_use.values)
        .or_else(|| nominal.map(|mount| nominal_values(&mount.pose())));
    match (used, view.estimate.as_deref()) {
        (Some(used), Some(estimate)) => compare(&used, estimate, situation.approval),
        // Nobody knows what the robot uses, so there is nothing that it has drifted from.
        (None, Some(_)) => Compared::Near,
        (_, None) => Compared::NotYet,
    }
}

/// Compares the known parameters with the values in use.
fn compare(
    used: &CalibrationValues,
    estimate: &EstimateDocument,
    policy: &approval::Policy,
) -> Compared {
    let [steering, x, y, yaw] = FOUR.map(|name| {
        let parameter = estimate.parameters.get(name);
        (parameter.status == ParameterStatus::Converged).then_some(parameter)
    });
    let estimated = CalibrationValues {
        steering_offset_rad: steering.map_or(used.steering_offset_rad, |one| one.value),
        lidar_x_m: x.map_or(used.lidar_x_m, |one| one.value),
        lidar_y_m: y.map_or(used.lidar_y_m, |one| one.value),
        lidar_yaw_rad: yaw.map_or(used.lidar_yaw_rad, |one| one.value),
        ..CalibrationValues::default()
    };
    let sigma = [steering, x, y, yaw].map(|known| known.map_or(0.0, |one| one.sigma));
    let change = difference(used, &estimated);
    let limits = policy.propose_beyond.limits();
    let mut sure = limits;
    for (sure, sigma) in sure.iter_mut().zip(&sigma) {
        *sure = sure.max(policy.propose_sigmas * sigma);
    }
    if change
        .iter()
        .zip(&sure)
        .any(|(part, most)| part.abs() > *most)
    {
        return Compared::Far(far_parts(&change, Some(&sigma), &sure));
    }
    let unknown = |name| {
        let status = estimate.parameters.get(name).status;
        matches!(
            status,
            ParameterStatus::Learning | ParameterStatus::Unobservable
        )
    };
    if FOUR.into_iter().any(unknown) {
        return Compared::NotYet;
    }
    Compared::Near
}

/// Parts of a change beyond their limits, in words.
fn far_parts(change: &approval::Change, sigma: Option<&[f64; 4]>, limits: &[f64; 4]) -> String {
    const NAMED: [(&str, f64, &str, usize); 4] = [
        ("steering offset", 180.0 / std::f64::consts::PI, "°", 2),
        ("LiDAR x", 1e3, " mm", 1),
        ("LiDAR y", 1e3, " mm", 1),
        ("LiDAR yaw", 180.0 / std::f64::consts::PI, "°", 2),
    ];
    let sigma = sigma.map_or([None; 4], |sigma| sigma.map(Some));
    let parts = NAMED.iter().zip(change).zip(limits).zip(sigma);
    let far = parts.filter(|(((_, part), limit), _)| part.abs() > **limit);
    let words: Vec<String> = far
        .map(|((((name, scale, unit, digits), part), _), sigma)| {
            let part = part * scale;
            let uncertainty = sigma.map_or_else(String::new, |sigma| {
                format!(" (sigma {:.digits$}{unit})", sigma * scale)
            });
            format!("{name} {part:+.digits$}{unit}{uncertainty}")
        })
        .collect();
    words.join(", ")
}
