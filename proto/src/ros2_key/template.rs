//! Place of a robot's id in the paths of its topics.

use std::fmt;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use fleetcal_model::RobotId;

const ROBOT: &str = "{robot}";
const DOMAIN: &str = "{domain}";
const TOPIC: &str = "{topic}";
/// Most chunks of a template.
const CHUNKS_MAX: usize = 16;

/// A chunk of a template.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Chunk {
    Robot,
    /// A number: the ROS domain.
    Domain,
    Any,
    Literal(String),
}

/// Template of a topic's path with the place of a robot's id: `{domain}/{robot}/{topic}`,
/// `site_a/{robot}/{topic}`, `*/{robot}/{topic}`.
///
/// `{domain}` is a number and `*` any one chunk. `{topic}` comes last and may be several chunks.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct KeyTemplate {
    /// Chunks without the topic.
    chunks: Vec<Chunk>,
}

/// Reason for which a text is not a template.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "key template {text:?} {reason}, expected chunks of {{robot}} (once), {{domain}}, * and \
     names, and {{topic}} last: {{domain}}/{{robot}}/{{topic}}"
)]
pub struct TemplateRefused {
    /// The text.
    pub text: String,
    /// Fault of the text.
    pub reason: &'static str,
}

/// Parts of a path that matches a template.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Matched<'p> {
    /// Id of the robot.
    pub robot: RobotId,
    /// Part before the topic.
    pub prefix: &'p str,
    /// The topic's name below the robot, `front/scan`.
    pub topic: &'p str,
}

impl KeyTemplate {
    /// Checks a text and makes it a template.
    ///
    /// # Errors
    /// One sentence that names the fault and the accepted form.
    pub fn parse(text: &str) -> Result<Self, TemplateRefused> {
        let refused = |reason| TemplateRefused {
            text: text.to_owned(),
            reason,
        };
        let before_topic = text
            .strip_suffix(TOPIC)
            .and_then(|front| front.strip_suffix('/'))
            .ok_or_else(|| refused("does not end in /{topic}"))?;
        let chunks: Vec<Chunk> = before_topic
            .split('/')
            .map(|chunk| match chunk {
                ROBOT => Ok(Chunk::Robot),
                DOMAIN => Ok(Chunk::Domain),
                "*" => Ok(Chunk::Any),
                "" => Err(refused("has an empty chunk")),
                name if name.contains(['*', '$', '?', '#', '{', '}', '@']) => {
                    Err(refused("has a chunk with one of * $ ? # @ { } in it"))
                }
                name => Ok(Chunk::Literal(name.to_owned())),
            })
            .collect::<Result<_, _>>()?;
        if chunks.len() > CHUNKS_MAX {
            return Err(refused("has more than 16 chunks"));
        }
        if chunks
            .iter()
            .filter(|&chunk| *chunk == Chunk::Robot)
            .count()
            != 1
        {
            return Err(refused("does not have {robot} once"));
        }
        Ok(Self { chunks })
    }

    /// Matches a path with this template; `None` if it has another shape.
    pub fn matched<'p>(&self, path: &'p str) -> Option<Matched<'p>> {
        let mut rest = path;
        let mut robot = None;
        for chunk in &self.chunks {
            let (first, behind) = rest.split_once('/')?;
            let fits = match chunk {
                Chunk::Robot => {
                    robot = RobotId::parse(first).ok();
                    robot.is_some()
                }
                Chunk::Domain => !first.is_empty() && first.bytes().all(|c| c.is_ascii_digit()),
                Chunk::Any => !first.is_empty(),
                Chunk::Literal(name) => first == name,
            };
            if !fits {
                return None;
            }
            rest = behind;
        }
        let prefix_bytes = path.len().checked_sub(rest.len() + 1)?;
        Some(Matched {
            robot: robot?,
            prefix: path.get(..prefix_bytes)?,
            topic: rest,
        })
        .filter(|matched| !matched.topic.is_empty())
    }

    /// Key expression of a topic's path, of one robot or of all.
    pub fn path_expression(&self, robot: Option<&RobotId>, topic: &str) -> String {
        let mut text = String::new();
        for chunk in &self.chunks {
            text.push_str(match (chunk, robot) {
                (Chunk::Robot, Some(robot)) => robot.as_str(),
                (Chunk::Robot | Chunk::Domain | Chunk::Any, _) => "*",
                (Chunk::Literal(name), _) => name,
            });
            text.push('/');
        }
        text + topic
    }
}

impl fmt::Display for KeyTemplate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for chunk in &self.chunks {
            let text = match chunk {
                Chunk::Robot => ROBOT,
                Chunk::Domain => DOMAIN,
                Chunk::Any => "*",
                Chunk::Literal(name) => name,
            };
            write!(f, "{text}/")?;
        }
        f.write_str(TOPIC)
    }
}

impl TryFrom<String> for KeyTemplate {
    type Error = TemplateRefused;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        Self::parse(&text)
    }
}

impl From<KeyTemplate> for String {
    fn from(template: KeyTemplate) -> Self {
        template.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn template(text: &str) -> KeyTemplate {
        let template = KeyTemplate::parse(text).unwrap();
        assert_eq!(template.to_string(), text);
        template
    }

    #[test]
    fn a_robot_is_found_where_the_template_has_it() {
        let cases = [
            ("{domain}/{robot}/{topic}", "0/tugger_01/front/scan"),
            ("{robot}/{domain}/{topic}", "tugger_01/0/front/scan"),
            ("{robot}/{topic}", "tugger_01/front/scan"),
            ("*/site/{robot}/{topic}", "7/site/tugger_01/front/scan"),
        ];
        for (text, path) in cases {
            let matched = template(text).matched(path).unwrap();
            assert_eq!(matched.robot.as_str(), "tugger_01", "{text}");
            assert_eq!(matched.topic, "front/scan");
            assert_eq!(format!("{}/front/scan", matched.prefix), path);
        }
        let by_domain = template("{robot}/{topic}").matched("7/scan").unwrap();
        assert_eq!(by_domain.robot.as_str(), "7");
    }

    #[test]
    fn what_is_of_another_shape_is_nobodys() {
        let usual = template("{domain}/{robot}/{topic}");
        for path in [
            "",
            "0",
            "0/a",
            "0/a/",
            "a/0/scan",
            "/a/scan",
            "0//scan",
            "0/a b/scan",
            "0/@a/scan",
        ] {
            assert_eq!(usual.matched(path), None, "{path:?}");
        }
    }

    #[test]
    fn expressions_hold_the_robot_or_all() {
        let usual = template("{domain}/{robot}/{topic}");
        let robot = RobotId::parse("tugger_01").unwrap();
        assert_eq!(usual.path_expression(None, "scan"), "*/*/scan");
        assert_eq!(
            usual.path_expression(Some(&robot), "front/scan"),
            "*/tugger_01/front/scan"
        );
    }

    #[test]
    fn each_refusal_names_the_template() {
        for (text, wanted) in [
            ("{domain}/{robot}", "does not end in /{topic}"),
            ("{topic}", "does not end in /{topic}"),
            ("{domain}/{topic}", "does not have {robot} once"),
            ("{robot}/{robot}/{topic}", "does not have {robot} once"),
            ("a//{robot}/{topic}", "empty chunk"),
            ("a*/{robot}/{topic}", "a chunk with one of"),
            ("@x/{robot}/{topic}", "a chunk with one of"),
        ] {
            let sentence = KeyTemplate::parse(text).unwrap_err().to_string();
            assert!(sentence.contains(wanted), "{sentence}");
            assert!(sentence.contains("expected"), "{sentence}");
        }
        let long = format!("{}{{robot}}/{{topic}}", "a/".repeat(16));
        assert!(KeyTemplate::parse(&long).is_err());
    }
}
