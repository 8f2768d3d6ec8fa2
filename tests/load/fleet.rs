//! Robots that send the same recording in real time, over one Zenoh session or one each.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use fleetcal_proto::RosMessage;
use fleetcal_proto::message_type::MessageType;
use fleetcal_proto::ros::DriveSamples;
use fleetcal_robot::recording::{Channel, Recording};
use fleetcal_tests::service::Service;
use serde_json::json;
use tokio::task::JoinSet;
use tokio::time::{Instant, sleep_until};
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;
use zenoh::{Config, Session};

/// Sessions of the robots.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sessions {
    /// One for all of them, as a bridge has.
    One,
    /// One for each robot, as robots have.
    Each,
}

/// Message of a robot, due some time after its start.
#[derive(Debug, Clone)]
struct Message {
    due: Duration,
    is_scan: bool,
    drive_samples: u64,
    payload: Vec<u8>,
}

/// Course that all robots drive: the messages of a recording.
#[derive(Debug, Clone)]
pub struct Course {
    messages: Vec<Message>,
    drive_encoding: String,
}

/// Number of messages that a robot sent.
#[derive(Debug, Clone, Copy, Default)]
pub struct Sent {
    /// Messages of wheel odometry.
    pub drives: u64,
    /// Drive samples in them.
    pub drive_samples: u64,
    /// Scans.
    pub scans: u64,
}

impl Course {
    /// Reads wheel odometry and scans of a recording.
    pub fn of(path: &Path) -> Self {
        let recording = Recording::open(path).unwrap();
        let channels = recording.channels();
        let of_stream = |name: &str| -> &Channel {
            let is_it = |channel: &&Channel| channel.topic.ends_with(name);
            channels.iter().find(is_it).unwrap()
        };
        let (drive, scan) = (of_stream("/wheel_odometry"), of_stream("/scan"));
        let topics = [drive.topic.as_str(), scan.topic.as_str()];
        let is_several = drive.known_type() == Some(MessageType::DriveSamples);
        let mut first_ns = None;
        let messages = recording.messages(&topics).unwrap().map(|message| {
            let message = message.unwrap();
            let is_scan = *message.topic == *scan.topic;
            let first_ns = *first_ns.get_or_insert(message.log_time_ns);
            let drive_samples = match (is_scan, is_several) {
                (true, _) => 0,
                (false, false) => 1,
                (false, true) => {
                    let samples = DriveSamples::from_cdr(&message.payload).unwrap();
                    samples.samples().len() as u64
                }
            };
            Message {
                due: Duration::from_nanos(message.log_time_ns - first_ns),
                is_scan,
                drive_samples,
                payload: message.payload,
            }
        });
        Self {
            messages: messages.collect(),
            drive_encoding: drive.form().to_text(),
        }
    }

    /// Sends everything as each of these robots, which begin one after the other within a tenth of
    /// a second.
    pub async fn drive(
        self: &Arc<Self>,
        service: &Service,
        names: &[String],
        sessions: Sessions,
    ) -> Vec<Sent> {
        let mut open = Vec::new();
        let mut robots = JoinSet::new();
        let began = Instant::now() + Duration::from_millis(500);
        for (number, name) in names.iter().enumerate() {
            if sessions == Sessions::Each || open.is_empty() {
                open.push(session(service).await);
            }
            let session = open.last().unwrap();
            let publisher = async |stream: &str, encoding: String| {
                session
                    .declare_publisher(format!("fleet/{name}/{stream}"))
                    .encoding(encoding)
                    .congestion_control(CongestionControl::Block)
                    .await
                    .unwrap()
            };
            let drives = publisher("wheel_odometry", self.drive_encoding.clone()).await;
            let scans = publisher("scan", "application/cdr".to_owned()).await;
            let after = Duration::from_millis(100) * number as u32 / names.len() as u32;
            let course = Arc::clone(self);
            robots.spawn(async move { course.send(&drives, &scans, began + after).await });
        }
        let sent = robots.join_all().await;
        for session in open {
            session.close().await.unwrap();
        }
        sent
    }

    async fn send(&self, drives: &Publisher<'_>, scans: &Publisher<'_>, began: Instant) -> Sent {
        let mut sent = Sent::default();
        for message in &self.messages {
            sleep_until(began + message.due).await;
            let publisher = if message.is_scan { scans } else { drives };
            publisher.put(message.payload.as_slice()).await.unwrap();
            sent.scans += u64::from(message.is_scan);
            sent.drives += u64::from(!message.is_scan);
            sent.drive_samples += message.drive_samples;
        }
        sent
    }
}

async fn session(service: &Service) -> Session {
    let connect = json!({ "mode": "client", "connect": { "endpoints": [service.endpoint()] } });
    let config = Config::from_json5(&connect.to_string()).unwrap();
    zenoh::open(config).await.unwrap()
}
