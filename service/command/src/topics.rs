//! Topics of a recording that a command uses, by its flags or by a robot's configuration.

use clap::Args;
use fleetcal_domain::robot::RobotConfig;
use fleetcal_domain::streams::{Joints, RobotStreams, StreamsFields};
use fleetcal_model::Stream;
use fleetcal_robot::recording::{AskedTopic, AskedTopics, Channel};

/// Flags that choose topics.
#[derive(Debug, Args)]
pub struct TopicArguments {
    /// The topic with measured speed and steering in one message, if there are several
    #[arg(
        long = "wheel-odometry-topic",
        alias = "drive-topic",
        value_name = "TOPIC"
    )]
    pub wheel_odometry: Option<String>,
    /// The topic with the steering angle, if it is separate from the speed
    #[arg(long = "steering-topic", value_name = "TOPIC")]
    pub steering: Option<String>,
    /// The topic with the speed, if it is separate from the steering angle
    #[arg(long = "speed-topic", value_name = "TOPIC")]
    pub speed: Option<String>,
    /// The topic with scans or clouds, if there are several
    #[arg(long = "scan-topic", value_name = "TOPIC")]
    pub scan: Option<String>,
    /// A topic with the LiDAR's pose, `Odometry` or `PoseStamped`, instead of its scans
    #[arg(long = "pose-topic", value_name = "TOPIC")]
    pub pose: Option<String>,
}

impl TopicArguments {
    /// Returns the topics that the flags name.
    pub fn asked(&self) -> AskedTopics {
        let asked = |topic: &Option<String>, by| {
            let topic = topic.clone()?;
            Some(AskedTopic { topic, by })
        };
        AskedTopics {
            wheel_odometry: asked(&self.wheel_odometry, "--wheel-odometry-topic"),
            steering: asked(&self.steering, "--steering-topic"),
            speed: asked(&self.speed, "--speed-topic"),
            scan: asked(&self.scan, "--scan-topic"),
            pose: asked(&self.pose, "--pose-topic"),
        }
    }

    /// Returns the topics that the flags name, else those of the robot's configuration.
    pub fn asked_or_configured(
        &self,
        robot: &str,
        config: &RobotConfig,
        channels: &[Channel],
    ) -> AskedTopics {
        let mut asked = self.asked();
        let configured = |stream: Stream, by| {
            let source = config.streams.fields().source(stream)?;
            let topic = recorded_as(channels, robot, source.topic.as_str());
            Some(AskedTopic { topic, by })
        };
        if asked.wheel_odometry.is_none() && asked.steering.is_none() && asked.speed.is_none() {
            asked.wheel_odometry = configured(Stream::WheelOdometry, "streams.wheel_odometry");
            asked.steering = configured(Stream::Steering, "streams.steering");
            asked.speed = configured(Stream::Speed, "streams.speed");
        }
        if asked.scan.is_none() && asked.pose.is_none() {
            asked.scan = configured(Stream::Scan, "streams.scan");
            asked.pose = configured(Stream::LidarOdometry, "streams.lidar_odometry");
        }
        asked
    }
}

/// Returns the topic of a recording that a robot's configuration calls `name`: below the robot, at
/// the top, or the only one with this ending.
fn recorded_as(channels: &[Channel], robot: &str, name: &str) -> String {
    let (below, top) = (format!("/{robot}/{name}"), format!("/{name}"));
    let has = |topic: &str| channels.iter().any(|channel| channel.topic == topic);
    if has(&below) {
        return below;
    }
    if has(&top) {
        return top;
    }
    let mut ending = channels.iter().filter(|of| of.topic.ends_with(&top));
    match (ending.next(), ending.next()) {
        (Some(only), None) => only.topic.clone(),
        _ => below,
    }
}

/// Parses the flag of the joints, which has the keys of `streams.joints`.
///
/// # Errors
/// One sentence that names the fault and the accepted form.
pub fn joints(text: &str) -> Result<Joints, String> {
    let fields: StreamsFields = toml::from_str(&format!("joints = {text}")).map_err(|error| {
        format!(
            "{}, expected a table as in the configuration: {{ steering = \"steer_joint\" }}",
            error.message()
        )
    })?;
    let joints = fields.joints.clone();
    RobotStreams::try_from(fields)?;
    joints.ok_or_else(|| "expected a table: { steering = \"steer_joint\" }".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn channel(topic: &str) -> Channel {
        Channel {
            topic: topic.to_owned(),
            message_type: "sensor_msgs/msg/JointState".to_owned(),
            encoding: None,
            count: 1,
        }
    }

    #[test]
    fn a_configured_topic_is_found_below_the_robot_or_at_the_top() {
        let recorded = |topics: &[&str]| {
            let channels: Vec<Channel> = topics.iter().map(|topic| channel(topic)).collect();
            recorded_as(&channels, "a", "joint_states")
        };
        assert_eq!(
            recorded(&["/joint_states", "/a/joint_states"]),
            "/a/joint_states"
        );
        assert_eq!(
            recorded(&["/joint_states", "/b/joint_states"]),
            "/joint_states"
        );
        assert_eq!(
            recorded(&["/site/a/joint_states", "/odom"]),
            "/site/a/joint_states"
        );
        // Of two nothing is guessed.
        let two = ["/b/joint_states", "/c/joint_states"];
        assert_eq!(recorded(&two), "/a/joint_states");
    }

    #[test]
    fn joints_are_a_table_with_the_keys_of_the_configuration() {
        let read = joints("{ steering = 'steer', steering_gear = 0.5 }");
        assert_eq!(read.map(|of| of.steering), Ok(Some("steer".to_owned())));
        for (text, wanted) in [
            ("steer", "expected a table"),
            ("{ steer = 'a' }", "steer"),
            (
                "{ steering = 'a', steering_gear = 0 }",
                "steering_gear: got 0",
            ),
            ("{ wheels = ['a'] }", "wheel_radius_m: got nothing"),
        ] {
            let sentence = joints(text).expect_err("refused");
            assert!(sentence.contains(wanted), "{text}: {sentence}");
        }
    }
}
