//! Topics of the event stream: a page receives only the topics that it shows.

use std::collections::BTreeSet;

use axum::http::StatusCode;
use fleetcal_proto::RobotId;

use super::live_event::EventName;
use super::problem::Problem;
use fleetcal_domain::limits;

/// Topic of the event stream.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
enum Topic {
    /// Lean row of each robot, and its state.
    Fleet,
    /// All events about one robot.
    Robot(RobotId),
    /// Changes of alerts.
    Alerts,
    /// Changes of a robot's proposals, deployments or shadow.
    Approvals,
    /// Changes of the policy, the deployment freeze or a roll-out.
    Deployments,
}

/// Updates that a listener wants.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Wanted {
    /// All updates but the lean rows, whose estimates it receives in full.
    All,
    /// All updates about one robot but the lean rows.
    OfRobot(RobotId),
    /// Updates of these topics.
    Topics(Topics),
}

/// Topics of one listener.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Topics(BTreeSet<Topic>);

impl Topics {
    /// Parses a list such as `fleet,robot:tugger_01,alerts`.
    pub(super) fn parse(text: &str) -> Result<Self, Problem> {
        const ACCEPTED: &str =
            "fleet, robot:ID, alerts, approvals and deployments, separated by commas";
        let refused = || Problem::refused("topics", text, ACCEPTED);
        let mut topics = BTreeSet::new();
        for name in text.split(',') {
            topics.insert(match name {
                "fleet" => Topic::Fleet,
                "alerts" => Topic::Alerts,
                "approvals" => Topic::Approvals,
                "deployments" => Topic::Deployments,
                _ => {
                    let id = name.strip_prefix("robot:").ok_or_else(refused)?;
                    Topic::Robot(RobotId::parse(id).map_err(|_| refused())?)
                }
            });
        }
        if topics.len() > limits::HTTP_STREAM_TOPICS_MAX {
            let detail = format!(
                "topics: got {}, expected {} at most",
                topics.len(),
                limits::HTTP_STREAM_TOPICS_MAX
            );
            let status = StatusCode::BAD_REQUEST;
            return Err(Problem::new(status, "value_refused", detail).of_field("topics"));
        }
        Ok(Self(topics))
    }

    fn has(&self, topic: &Topic) -> bool {
        self.0.contains(topic)
    }
}

impl Wanted {
    /// True if an event of this name about this robot (`None`: about no single one) is wanted.
    pub(super) fn includes(&self, name: EventName, robot: Option<&RobotId>) -> bool {
        match self {
            Self::All => name != EventName::Rows,
            Self::OfRobot(wanted) => {
                name != EventName::Rows && robot.is_none_or(|robot| robot == wanted)
            }
            Self::Topics(topics) => topics.include(name, robot),
        }
    }
}

impl Topics {
    fn include(&self, name: EventName, robot: Option<&RobotId>) -> bool {
        let of_robot = || robot.is_some_and(|robot| self.has(&Topic::Robot(robot.clone())));
        match name {
            EventName::Ready | EventName::Resync => true,
            EventName::Rows => self.has(&Topic::Fleet),
            EventName::RobotState => self.has(&Topic::Fleet) || of_robot(),
            EventName::Estimate | EventName::Event => of_robot(),
            EventName::Approval => self.has(&Topic::Approvals) || of_robot(),
            EventName::Alert => self.has(&Topic::Alerts) || of_robot(),
            EventName::Freeze | EventName::Policy | EventName::Rollout => {
                self.has(&Topic::Deployments)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use strum::IntoEnumIterator;

    use super::*;

    fn robot(id: &str) -> RobotId {
        RobotId::parse(id).unwrap()
    }

    fn heard(topics: &str, about: Option<&str>) -> Vec<&'static str> {
        let wanted = Wanted::Topics(Topics::parse(topics).unwrap());
        let about = about.map(robot);
        let names = EventName::iter();
        let heard = names.filter(|name| wanted.includes(*name, about.as_ref()));
        heard.map(EventName::as_str).collect()
    }

    #[test]
    fn a_page_hears_what_it_shows_and_nothing_else() {
        let always = ["ready", "resync"];
        let of = |names: &[&'static str]| {
            let mut all: Vec<_> = names.iter().chain(&always).copied().collect();
            all.sort_unstable();
            all
        };
        let sorted = |mut names: Vec<&'static str>| {
            names.sort_unstable();
            names
        };
        assert_eq!(
            sorted(heard("fleet", Some("a"))),
            of(&["rows", "robot_state"])
        );
        let whole = ["estimate", "robot_state", "event", "approval", "alert"];
        assert_eq!(sorted(heard("robot:a", Some("a"))), of(&whole));
        assert_eq!(sorted(heard("robot:a", Some("b"))), of(&[]));
        let base = "alerts,approvals,deployments";
        let told = ["approval", "alert", "freeze", "policy", "rollout"];
        assert_eq!(sorted(heard(base, Some("b"))), of(&told));
    }

    #[test]
    fn an_unknown_topic_is_refused() {
        for text in ["", "fleet,", "robot:", "robot:a*", "estimate"] {
            assert!(Topics::parse(text).is_err(), "{text}");
        }
        let many: Vec<String> = (0..9).map(|number| format!("robot:a{number}")).collect();
        assert!(Topics::parse(&many.join(",")).is_err());
    }
}
