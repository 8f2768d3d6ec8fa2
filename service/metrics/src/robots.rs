//! Metrics of each robot, as text that is made piece by piece.

use std::fmt::{self, Write};
use std::sync::Arc;

use fleetcal_domain::deviation::Deviation;
use fleetcal_domain::limits;
use fleetcal_domain::robot::{Counters, RobotConfig, RobotView};
use fleetcal_model::{
    Detection, DetectionState, Label, Parameter, ParameterStatus, Unit, WallTime,
};
use fleetcal_proto::RobotId;

/// Figures of one robot at one time: a small part of their text.
#[derive(Debug)]
pub struct RobotFigures {
    robot: RobotId,
    /// Its site and vehicle type, as labels of a series.
    groups: Box<str>,
    /// Number of its messages by outcome, in the order of [`OUTCOMES`].
    outcomes: [u64; OUTCOMES.len()],
    unpaired: u64,
    restarts: u64,
    detection: Option<Detection>,
    /// Deviation of its estimate from the calibration in use, tolerances.
    deviation: Option<f64>,
    /// Receipt of its last message, wall time.
    last_seen: Option<WallTime>,
    /// Value and sigma of each of [`SHOWN`]; `None` while its estimate says nothing of it.
    estimate: [Option<(f64, f64)>; SHOWN.len()],
}

/// Parameters of the estimate.
const SHOWN: [Parameter; 4] = [
    Parameter::SteeringOffset,
    Parameter::LidarX,
    Parameter::LidarY,
    Parameter::LidarYaw,
];

/// Outcomes of a message; those that wait are the difference to those received.
const OUTCOMES: [&str; 6] = [
    "processed",
    "refused",
    "ignored",
    "dropped_wheel_odometry",
    "dropped_scan",
    "dropped_note",
];

impl RobotFigures {
    /// Takes the figures from a robot's view.
    pub fn of(view: &RobotView, deviation: Option<Deviation>) -> Self {
        let Counters {
            processed,
            refused,
            ignored,
            dropped_wheel_odometry,
            dropped_scans,
            dropped_notes,
            ..
        } = view.counters;
        Self {
            robot: view.id.clone(),
            groups: groups(view.config.as_ref()),
            outcomes: [
                processed,
                refused,
                ignored,
                dropped_wheel_odometry,
                dropped_scans,
                dropped_notes,
            ],
            unpaired: view.pairing.map_or(0, |pairing| pairing.unpaired),
            restarts: u64::from(view.estimator_restarts),
            detection: view
                .estimate
                .as_ref()
                .and_then(|estimate| estimate.detection),
            deviation: deviation.map(|one| one.tolerances),
            last_seen: view.connection.last_heard(),
            estimate: SHOWN.map(|name| {
                let parameter = view.estimate.as_deref()?.parameters.get(name);
                let is_known = matches!(
                    parameter.status,
                    ParameterStatus::Converged | ParameterStatus::Learning | ParameterStatus::Fixed
                );
                is_known.then_some((parameter.value, parameter.sigma))
            }),
        }
    }

    /// Returns the number of messages that found a full mailbox.
    pub fn mailbox_full(&self) -> u64 {
        let [_, _, _, dropped @ ..] = self.outcomes;
        dropped.iter().sum()
    }
}

/// Samples of one name.
struct Family {
    name: &'static str,
    help: &'static str,
    kind: &'static str,
    /// Writes a robot's samples.
    write: fn(&mut String, &RobotFigures) -> fmt::Result,
}

const FAMILIES: [Family; 11] = [
    Family {
        name: "fleetcal_robot",
        help: "Groups of each robot, to join with its other series; empty where none is given",
        kind: "info",
        write: info,
    },
    Family {
        name: "fleetcal_robot_messages",
        help: "Messages of each robot, by what became of them",
        kind: "counter",
        write: messages,
    },
    Family {
        name: "fleetcal_robot_unpaired",
        help: "Speeds without a steering angle near enough",
        kind: "counter",
        write: unpaired,
    },
    Family {
        name: "fleetcal_robot_estimator_restarts",
        help: "Restarts of its estimator",
        kind: "counter",
        write: restarts,
    },
    Family {
        name: "fleetcal_robot_change_detection",
        help: "1 while a change of this cause would be detected, 0 while detection waits",
        kind: "gauge",
        write: detection,
    },
    Family {
        name: "fleetcal_robot_deviation_tolerances",
        help: "Distance of its estimate from the calibration in use, of the value which is farthest",
        kind: "gauge",
        write: deviation,
    },
    Family {
        name: "fleetcal_robot_last_message_timestamp_seconds",
        help: "Receipt of its last message, since 1970",
        kind: "gauge",
        write: last_message,
    },
    Family {
        name: "fleetcal_robot_estimate_radians",
        help: "Estimated angles, converged or not",
        kind: "gauge",
        write: |out, robot| estimates(out, robot, Unit::Radian, "estimate_radians", |one| one.0),
    },
    Family {
        name: "fleetcal_robot_estimate_sigma_radians",
        help: "Standard deviations of the estimated angles",
        kind: "gauge",
        write: |out, robot| {
            estimates(out, robot, Unit::Radian, "estimate_sigma_radians", |one| {
                one.1
            })
        },
    },
    Family {
        name: "fleetcal_robot_estimate_meters",
        help: "Estimated positions, converged or not",
        kind: "gauge",
        write: |out, robot| estimates(out, robot, Unit::Metre, "estimate_meters", |one| one.0),
    },
    Family {
        name: "fleetcal_robot_estimate_sigma_meters",
        help: "Standard deviations of the estimated positions",
        kind: "gauge",
        write: |out, robot| {
            estimates(out, robot, Unit::Metre, "estimate_sigma_meters", |one| {
                one.1
            })
        },
    },
];

/// Formats these robots' figures in pieces of a few robots at a time.
pub fn pieces(robots: Vec<RobotFigures>) -> impl Iterator<Item = String> + Send + 'static {
    let robots: Arc<[RobotFigures]> = robots.into();
    FAMILIES.iter().flat_map(move |family| {
        let robots = Arc::clone(&robots);
        let firsts = (0..robots.len()).step_by(limits::METRICS_ROBOTS_AT_ONCE);
        std::iter::once(head(family)).chain(firsts.map(move |first| {
            let mut written = String::new();
            let some = robots.iter().skip(first);
            let some = some.take(limits::METRICS_ROBOTS_AT_ONCE);
            // To write into a `String` cannot fail.
            let whole = some
                .map(|robot| (family.write)(&mut written, robot))
                .all(|one| one.is_ok());
            debug_assert!(whole, "{}", family.name);
            written
        }))
    })
}

fn head(family: &Family) -> String {
    let Family {
        name, help, kind, ..
    } = family;
    format!("# HELP {name} {help}\n# TYPE {name} {kind}\n")
}

/// Formats site and vehicle type as labels of a series.
fn groups(config: Option<&RobotConfig>) -> Box<str> {
    let site = config.and_then(|config| config.site.as_ref());
    let kind = config.and_then(|config| config.vehicle_type.as_ref());
    let [site, kind] = [site, kind].map(|group| group.map_or(String::new(), escaped));
    format!("site=\"{site}\",vehicle_type=\"{kind}\"").into()
}

/// Escapes a group's name as the text format requires it; a label has no line break.
fn escaped(group: &Label) -> String {
    group.as_str().replace('\\', "\\\\").replace('"', "\\\"")
}

fn info(out: &mut String, robot: &RobotFigures) -> fmt::Result {
    let (id, groups) = (robot.robot.as_str(), &robot.groups);
    writeln!(out, "fleetcal_robot_info{{robot=\"{id}\",{groups}}} 1")
}

// Values of the labels below are ids and words of letters, digits, `_` and `-`: none needs an escape.

fn messages(out: &mut String, robot: &RobotFigures) -> fmt::Result {
    let id = robot.robot.as_str();
    for (outcome, count) in OUTCOMES.iter().zip(robot.outcomes) {
        let labels = format_args!("robot=\"{id}\",outcome=\"{outcome}\"");
        writeln!(out, "fleetcal_robot_messages_total{{{labels}}} {count}")?;
    }
    Ok(())
}

fn unpaired(out: &mut String, robot: &RobotFigures) -> fmt::Result {
    let (id, count) = (robot.robot.as_str(), robot.unpaired);
    writeln!(
        out,
        "fleetcal_robot_unpaired_total{{robot=\"{id}\"}} {count}"
    )
}

fn restarts(out: &mut String, robot: &RobotFigures) -> fmt::Result {
    let (id, count) = (robot.robot.as_str(), robot.restarts);
    let name = "fleetcal_robot_estimator_restarts_total";
    writeln!(out, "{name}{{robot=\"{id}\"}} {count}")
}

/// Writes one series for each robot and cause; the missing condition of its detection is a label.
fn detection(out: &mut String, robot: &RobotFigures) -> fmt::Result {
    let id = robot.robot.as_str();
    let of_causes = robot.detection.map(|detection| detection.of_causes());
    for (cause, state) in of_causes.into_iter().flatten() {
        let (cause, word): (&str, &str) = (cause.into(), state.into());
        let labels = format_args!("robot=\"{id}\",cause=\"{cause}\",state=\"{word}\"");
        let watching = u32::from(state == DetectionState::Watching);
        writeln!(
            out,
            "fleetcal_robot_change_detection{{{labels}}} {watching}"
        )?;
    }
    Ok(())
}

fn deviation(out: &mut String, robot: &RobotFigures) -> fmt::Result {
    let Some(tolerances) = robot.deviation else {
        return Ok(());
    };
    let (name, id) = ("fleetcal_robot_deviation_tolerances", robot.robot.as_str());
    writeln!(out, "{name}{{robot=\"{id}\"}} {tolerances}")
}

fn last_message(out: &mut String, robot: &RobotFigures) -> fmt::Result {
    let Some(WallTime(at_ns)) = robot.last_seen else {
        return Ok(());
    };
    let name = "fleetcal_robot_last_message_timestamp_seconds";
    let (id, at_s) = (robot.robot.as_str(), at_ns as f64 / 1e9);
    writeln!(out, "{name}{{robot=\"{id}\"}} {at_s}")
}

/// Writes one series for each parameter of a unit, with one `part` of its value and sigma.
fn estimates(
    out: &mut String,
    robot: &RobotFigures,
    unit: Unit,
    name: &str,
    part: fn((f64, f64)) -> f64,
) -> fmt::Result {
    let id = robot.robot.as_str();
    for (parameter, estimate) in SHOWN.into_iter().zip(robot.estimate) {
        if let Some(estimate) = estimate
            && parameter.unit() == unit
        {
            let labels = format_args!("robot=\"{id}\",parameter=\"{}\"", parameter.name());
            writeln!(out, "fleetcal_robot_{name}{{{labels}}} {}", part(estimate))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use super::*;

    fn figures(number: usize) -> RobotFigures {
        RobotFigures {
            robot: RobotId::parse(&format!("warehouse_tugger_{number:04}")).unwrap(),
            groups: groups(None),
            outcomes: [1_000_000_000, 1, 2, 3, 4, 5],
            unpaired: 6,
            restarts: 7,
            detection: Some(Detection::of_all(DetectionState::Watching)),
            deviation: Some(1.25),
            last_seen: Some(WallTime(1_500_000_000)),
            estimate: [
                Some((0.25, 0.5)),
                Some((1.5, 0.125)),
                None,
                Some((-0.5, 0.0625)),
            ],
        }
    }

    #[test]
    fn each_piece_has_some_robots_of_one_family() {
        let all: String = pieces(vec![figures(1)]).collect();
        let lines: Vec<&str> = all.lines().collect();
        assert_eq!(lines.len(), 11 * 2 + 1 + 6 + 1 + 1 + 3 + 1 + 1 + 2 * 3);
        for line in [
            "fleetcal_robot_deviation_tolerances{robot=\"warehouse_tugger_0001\"} 1.25",
            "fleetcal_robot_last_message_timestamp_seconds{robot=\"warehouse_tugger_0001\"} 1.5",
            "fleetcal_robot_estimate_meters{robot=\"warehouse_tugger_0001\",parameter=\"lidar_x\"} 1.5",
            "fleetcal_robot_estimate_sigma_radians{robot=\"warehouse_tugger_0001\",parameter=\"lidar_yaw\"} \
             0.0625",
        ] {
            assert!(lines.contains(&line), "{line}");
        }
        assert_eq!(
            lines[..6],
            [
                "# HELP fleetcal_robot Groups of each robot, to join with its other series; empty \
                 where none is given",
                "# TYPE fleetcal_robot info",
                "fleetcal_robot_info{robot=\"warehouse_tugger_0001\",site=\"\",vehicle_type=\"\"} 1",
                "# HELP fleetcal_robot_messages Messages of each robot, by what became of them",
                "# TYPE fleetcal_robot_messages counter",
                "fleetcal_robot_messages_total{robot=\"warehouse_tugger_0001\",\
                 outcome=\"processed\"} 1000000000",
            ]
        );
        assert_eq!(figures(1).mailbox_full(), 12);
        let quoted = Label::parse(r#"hall "B\C""#).unwrap();
        assert_eq!(escaped(&quoted), r#"hall \"B\\C\""#);
    }

    #[expect(clippy::disallowed_methods, reason = "the test says how long it took")]
    #[test]
    fn as_many_robots_as_there_can_be_are_written_a_little_at_a_time() {
        let all = (0..limits::ROBOTS_MAX).map(figures).collect();
        let began = Instant::now();
        let (mut bytes, mut longest) = (0, 0);
        for piece in pieces(all) {
            longest = longest.max(piece.len());
            bytes += piece.len();
        }
        let took = began.elapsed();
        println!("{bytes} bytes in {took:?}, {longest} at once");
        assert!(bytes > 1 << 20 && longest < 128 << 10, "{bytes}, {longest}");
        assert!(took < Duration::from_secs(1), "{took:?}");
        assert!(size_of::<RobotFigures>() <= 256);
    }
}
