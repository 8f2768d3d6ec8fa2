//! Configuration of an operator: `fleetcal.toml`, and each robot in it or in the API.

mod cluster;

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

pub use cluster::ClusterConfig;

use fleetcal_domain::alert::AlertPolicy;
use fleetcal_domain::approval::Policy;
use fleetcal_domain::limits;
use fleetcal_domain::robot::RobotConfig;
use fleetcal_domain::streams::Ros2Settings;
use fleetcal_estimator::EstimatorSettings;
use fleetcal_http::TrustedProxies;
use fleetcal_http::{PublicUrl, SecurityContact};
use fleetcal_proto::{KeyRoot, RobotId};
use fleetcal_store::database_url::PostgresUrl;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use sha2::{Digest, Sha256};
use thiserror::Error;

/// Reads settings that an estimator can work with.
fn checked_settings<'de, D: Deserializer<'de>>(from: D) -> Result<EstimatorSettings, D::Error> {
    let settings = EstimatorSettings::deserialize(from)?;
    settings.check().map_err(D::Error::custom)?;
    Ok(settings)
}

/// Reads a valid policy.
fn checked_policy<'de, D: Deserializer<'de>>(from: D) -> Result<Policy, D::Error> {
    let policy = Policy::deserialize(from)?;
    policy.check().map_err(D::Error::custom)?;
    Ok(policy)
}

/// Reads a valid policy of alerts.
fn checked_alerts<'de, D: Deserializer<'de>>(from: D) -> Result<AlertPolicy, D::Error> {
    let policy = AlertPolicy::deserialize(from)?;
    policy.check().map_err(D::Error::custom)?;
    Ok(policy)
}
/// One `[[robot]]` of `fleetcal.toml`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "toml::Table")]
pub struct RobotEntry {
    /// Its id, one chunk of a key.
    pub id: RobotId,
    /// Other settings of the robot.
    pub config: RobotConfig,
}

impl TryFrom<toml::Table> for RobotEntry {
    type Error = String;

    // `serde(flatten)` would switch off the refusal of unknown keys.
    fn try_from(mut table: toml::Table) -> Result<Self, String> {
        let Some(id) = table.remove("id") else {
            return Err("a [[robot]] has no `id`".to_owned());
        };
        let id: RobotId = id
            .try_into()
            .map_err(|error: toml::de::Error| error.message().to_owned())?;
        let config = table
            .try_into()
            .map_err(|error: toml::de::Error| format!("robot {id}: {}", error.message()))?;
        Ok(Self { id, config })
    }
}

/// `fleetcal.toml`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Folder of the signing key, and of the database unless `database` names another.
    pub data: PathBuf,
    /// PostgreSQL that keeps the records instead of a database in that folder.
    pub database: Option<PostgresUrl>,
    /// File whose first line is the database's password.
    pub database_password_file: Option<PathBuf>,
    /// Address of the API and the dashboard.
    pub http: SocketAddr,
    /// Public address of the API and the dashboard, if different.
    pub public_url: Option<PublicUrl>,
    /// Contacts for reports of vulnerabilities, which `/.well-known/security.txt` names.
    pub security_contacts: Vec<SecurityContact>,
    /// Proxies whose forwarded client addresses are trusted.
    pub trusted_proxies: TrustedProxies,
    /// Zenoh endpoints that the embedded router listens on.
    pub listen: Vec<String>,
    /// Zenoh routers to connect to.
    pub connect: Vec<String>,
    /// A native Zenoh configuration file, used instead of `listen` and `connect`; its QUIC
    /// endpoints are set to one stream.
    pub zenoh_config: Option<PathBuf>,
    /// True if peers beyond this machine may connect to Zenoh without authentication.
    pub allow_anonymous: bool,
    /// Largest number of Zenoh sessions of one name, by password or certificate.
    pub sessions_per_name: usize,
    /// Largest number of Zenoh sessions of one address without a name.
    pub sessions_per_address: usize,
    /// Largest number of Zenoh sessions without a name; by the memory that the process may use
    /// unless given.
    pub sessions_without_name: Option<usize>,
    /// First chunk of every key.
    pub root: KeyRoot,
    /// Settings of the topics of ROS 2 robots.
    pub ros2: Ros2Settings,
    /// Settings of every estimator, unless its robot has its own.
    #[serde(deserialize_with = "checked_settings")]
    pub estimator: EstimatorSettings,
    /// Rules for proposing, approving and verifying calibrations.
    #[serde(deserialize_with = "checked_policy")]
    pub approval: Policy,
    /// Alerts for operators, and their delays.
    #[serde(deserialize_with = "checked_alerts")]
    pub alerts: AlertPolicy,
    /// This service as one instance of several.
    pub cluster: ClusterConfig,
    /// Robots that are configured beforehand.
    #[serde(rename = "robot")]
    pub robots: Vec<RobotEntry>,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            data: PathBuf::from("fleetcal-data"),
            database: None,
            database_password_file: None,
            http: SocketAddr::from(([127, 0, 0, 1], 8080)),
            public_url: None,
            security_contacts: Vec::new(),
            trusted_proxies: TrustedProxies::default(),
            listen: vec!["tcp/127.0.0.1:7447".to_owned()],
            connect: Vec::new(),
            zenoh_config: None,
            allow_anonymous: false,
            sessions_per_name: limits::ZENOH_SESSIONS_PER_NAME_DEFAULT,
            sessions_per_address: limits::ZENOH_SESSIONS_PER_ADDRESS_DEFAULT,
            sessions_without_name: None,
            root: KeyRoot::default(),
            ros2: Ros2Settings::default(),
            estimator: EstimatorSettings::default(),
            approval: Policy::default(),
            alerts: AlertPolicy::default(),
            cluster: ClusterConfig::default(),
            robots: Vec::new(),
        }
    }
}

/// Reason for which a configuration file could not be used.
#[derive(Debug, Error)]
pub enum ConfigError {
    /// The file could not be read.
    #[error("cannot read the configuration {path}: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// The content is refused.
    #[error("the configuration {path} is refused: {reason}")]
    Refused {
        /// The file.
        path: PathBuf,
        /// Line and key, and the accepted values.
        reason: String,
    },
}

impl Config {
    /// Reads a configuration file.
    ///
    /// # Errors
    /// The file cannot be read, is not TOML, or holds an unknown key or an impossible value.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let text = std::fs::read_to_string(path).map_err(|source| ConfigError::Read {
            path: path.to_owned(),
            source,
        })?;
        Self::parse(&text).map_err(|reason| ConfigError::Refused {
            path: path.to_owned(),
            reason,
        })
    }

    /// Parses the text of a configuration file.
    ///
    /// # Errors
    /// One sentence that names the line and the key.
    pub fn parse(text: &str) -> Result<Self, String> {
        let config: Self = toml::from_str(text).map_err(|error| {
            let line = line_of(text, error.span());
            let message = error.message().replace('\n', ", ");
            format!("line {line}: {message}")
        })?;
        config.cluster.check()?;
        let mut seen = std::collections::BTreeSet::new();
        for robot in &config.robots {
            if !seen.insert(&robot.id) {
                return Err(format!("robot {} is configured twice", robot.id));
            }
        }
        for robot in &config.robots {
            if let Some(own) = &robot.config.estimator {
                let settings = own.over(&config.estimator);
                settings
                    .map_err(|refused| format!("estimator of robot {}: {refused}", robot.id))?;
            }
        }
        let mut prefixes = std::collections::BTreeMap::new();
        for robot in &config.robots {
            let Some(prefix) = &robot.config.streams.fields().prefix else {
                continue;
            };
            if let Some(other) = prefixes.insert(prefix.as_str(), &robot.id) {
                let prefix = prefix.as_str();
                return Err(format!(
                    "streams.prefix of robot {} is {prefix:?}, which is that of {other} already",
                    robot.id
                ));
            }
        }
        Ok(config)
    }
}

impl Config {
    /// Returns the SHA-256 of the settings that all instances of a cluster have to agree in:
    /// estimation of robots, approval, alerts, and the robots configured beforehand.
    pub fn agreed_sha256(&self) -> Vec<u8> {
        let robots = self.robots.iter().map(|robot| (&robot.id, &robot.config));
        let robots: std::collections::BTreeMap<_, _> = robots.collect();
        let agreed = serde_json::json!({
            "root": self.root,
            "ros2": self.ros2,
            "estimator": self.estimator,
            "approval": self.approval,
            "alerts": self.alerts,
            "robots": robots,
        });
        Sha256::digest(agreed.to_string()).to_vec()
    }
}

/// Returns the line of a TOML text that an error is about.
pub fn line_of(text: &str, span: Option<std::ops::Range<usize>>) -> usize {
    let before = span.and_then(|span| text.get(..span.start));
    before.map_or(1, |before| before.matches('\n').count() + 1)
}

#[cfg(test)]
mod tests {
    use fleetcal_model::Pose2;
    use fleetcal_proto::message_type::ScanType;

    use super::*;

    const WHOLE: &str = r#"
        data = "/var/lib/fleetcal"
        http = "127.0.0.1:9000"
        listen = ["tcp/127.0.0.1:7447"]
        connect = []

        [estimator]
        anchor_distance_m = 4.0

        [[robot]]
        id = "tugger_01"
        model = "bicycle"
        wheelbase_m = 1.2
        nominal_extrinsics = { x_m = 0.434, y_m = 0.0, yaw_rad = 0.0 }
        wheel_odometry = "raw"
    "#;

    fn refusal(text: &str) -> String {
        Config::parse(text).expect_err("must be refused")
    }

    #[test]
    fn the_documented_file_is_accepted() {
        let config = Config::parse(WHOLE).expect("documented");
        let robot = config.robots.first().expect("one robot");
        assert_eq!(robot.id.as_str(), "tugger_01");
        assert!((robot.config.vehicle().wheelbase_m - 1.2).abs() < 1e-12);
        assert_eq!(
            robot.config.nominal_extrinsics.map(|m| m.pose()),
            Some(Pose2::new(0.434, 0.0, 0.0))
        );
    }

    #[test]
    fn the_papers_filter_is_refused_by_name() {
        for table in [
            "[estimator]",
            "[[robot]]\nid = \"a\"\nmodel = \"bicycle\"\nwheelbase_m = 1.2\n[robot.estimator]",
        ] {
            let refused = refusal(&format!("{table}\nmeasurement = \"anchored\"\n"));
            assert!(
                refused.contains("measurement: got anchored, expected no such key"),
                "{refused}"
            );
        }
    }

    #[test]
    fn the_example_holds_every_key_with_its_default() {
        let example = include_str!("../../../fleetcal.example.toml");
        assert_eq!(Config::parse(example), Ok(Config::default()));
        let written: toml::Table = toml::from_str(example).expect("TOML");
        let settings = toml::Table::try_from(EstimatorSettings::default()).expect("a table");
        for (key, value) in settings {
            assert_eq!(
                written["estimator"].get(&key),
                Some(&value),
                "estimator.{key}"
            );
        }
        let policy = toml::Table::try_from(Policy::default()).expect("a table");
        for (key, value) in policy {
            assert_eq!(
                written["approval"].get(&key),
                Some(&value),
                "approval.{key}"
            );
        }
        // What is commented out there is accepted as well.
        let whole = example
            .replace("# zenoh_config", "zenoh_config")
            .replace("# public_url", "public_url")
            .replace("# approve_within", "approve_within")
            .replace("# instance", "instance")
            .replace("# url", "url")
            .replace("# peers", "peers")
            .replace("# peer_root", "peer_root")
            .replace("# signing_key", "signing_key")
            .replace("# [[robot]]", "[[robot]]")
            .replace("# [robot.estimator]", "[robot.estimator]");
        let keys = [
            "id",
            "model",
            "wheelbase_m",
            "speed_measured_at",
            "nominal_extrinsics",
            "wheel_odometry",
            "rear_axle_in",
        ];
        let whole = keys.iter().fold(whole, |text, key| {
            text.replace(&format!("\n# {key}"), &format!("\n{key}"))
        });
        let config = Config::parse(&whole).expect("documented");
        assert_eq!(config.robots.len(), 1);
    }

    #[test]
    fn former_names_of_wheel_odometry_are_read() {
        let former = "[ros2]\ndrive = \"feedback\"\n\n[[robot]]\nid = \"a\"\nmodel = \"bicycle\"\n\
                      wheelbase_m = 1.2\ndrive = \"compensated\"\n\
                      streams = { drive = { topic = \"drive\" } }\n";
        let read = Config::parse(former).expect("read");
        let today = former.replace("drive =", "wheel_odometry =");
        assert_eq!(Config::parse(&today), Ok(read));
    }

    #[test]
    fn a_robot_has_the_settings_of_all_but_for_its_own() {
        let text = "[estimator]\nanchor_distance_m = 4.0\nconverged_sigma = { lidar_y = 0.02 }\n\
                    [[robot]]\nid = \"a\"\nmodel = \"bicycle\"\nwheelbase_m = 1.2\n\
                    [robot.estimator]\nfalse_alarm_hours = 500\nconverged_sigma = { lidar_x = 0.01 }\n";
        let config = Config::parse(text).expect("accepted");
        let robot = config.robots.first().expect("one robot");
        let mut expected = config.estimator.clone();
        expected.false_alarm_hours = 500.0;
        expected.converged_sigma.lidar_x = 0.01;
        assert_eq!(
            robot.config.calibrator_config(&config.estimator).settings,
            expected
        );
        let both = "[estimator]\nfree = { wheelbase = \"estimated\" }\n".to_owned()
            + "[[robot]]\nid = \"a\"\nmodel = \"bicycle\"\nwheelbase_m = 1.2\n"
            + "estimator = { free = { steering_gain = \"estimated\" } }\n";
        assert!(
            refusal(&both).contains("robot a: free.wheelbase"),
            "{}",
            refusal(&both)
        );
    }

    #[test]
    fn settings_that_contradict_each_other_are_refused() {
        let both = "[estimator]\npose_sigma_m = -1.0";
        assert!(refusal(both).contains("pose_sigma_m"), "{}", refusal(both));
        let robot = WHOLE.to_owned() + "[robot.estimator]\nanchor_distance_m = 0.0";
        assert!(
            refusal(&robot).contains("anchor_distance_m"),
            "{}",
            refusal(&robot)
        );
    }

    #[test]
    fn a_policy_that_cannot_be_followed_is_refused() {
        let refused = |text: &str| refusal(&format!("[approval]\n{text}"));
        assert!(refused("confirm_within_s = 0").contains("approval.confirm_within_s: got 0"));
        assert!(refused("propse = true").contains("propse"));
        let wide = "approve_within = { steering_offset_deg = 6.0, lidar_yaw_deg = 1.0, \
                    lidar_position_mm = 10.0 }";
        assert!(
            refused(wide).contains("approve_within: got more than two_approvers_beyond"),
            "{}",
            refused(wide)
        );
        let none = "verify_within = { steering_offset_deg = 0.0, lidar_yaw_deg = 1.0, \
                    lidar_position_mm = 10.0 }";
        assert!(refused(none).contains("verify_within.steering_offset_deg: got 0"));
    }

    #[test]
    fn an_unknown_key_is_refused_by_name_at_every_level() {
        assert!(refusal("htttp = \"127.0.0.1:1\"").contains("htttp"));
        assert!(refusal("[estimator]\nnoize = 1").contains("noize"));
        assert!(refusal(&WHOLE.replace("wheel_odometry =", "wheel_odom =")).contains("wheel_odom"));
        assert!(refusal(&WHOLE.replace("yaw_rad = 0.0", "yaw = 0.0")).contains("yaw"));
    }

    #[test]
    fn a_value_that_cannot_be_is_refused_with_what_is_accepted() {
        for wheelbase in ["0.0", "-1.2", "nan", "inf", "31.0"] {
            let text = WHOLE.replace("wheelbase_m = 1.2", &format!("wheelbase_m = {wheelbase}"));
            let reason = refusal(&text);
            assert!(
                reason.contains("wheelbase_m") && reason.contains("at most 30 m"),
                "{reason}"
            );
        }
        assert!(refusal(&WHOLE.replace("tugger_01", "tug/ger")).contains("tug/ger"));
        assert!(refusal(&WHOLE.replace("\"bicycle\"", "\"tank\"")).contains("tank"));
    }

    #[test]
    fn a_3d_scanner_is_configured_by_type_and_band() {
        let scans = |text: &str| {
            let config = Config::parse(text)?;
            Ok::<_, String>(config.robots.first().expect("one robot").config.scans())
        };
        let laser = scans(WHOLE).expect("documented");
        assert_eq!(laser.scan_type, ScanType::LaserScan);
        let text = format!(
            "{WHOLE}scan_type = \"point_cloud2\"\n\
             point_cloud = {{ height_min_m = -0.2, height_max_m = 1.5, beams = 720 }}\n"
        );
        let cloud = scans(&text).expect("documented");
        assert_eq!(cloud.scan_type, ScanType::PointCloud2);
        assert_ne!(cloud.band, laser.band);
        let reason = scans(&text.replace("1.5", "-1.5")).expect_err("upside down");
        assert!(
            reason.contains("height_max_m: got -1.5, expected"),
            "{reason}"
        );
        let reason = scans(&text.replace("beams", "beens")).expect_err("unknown");
        assert!(reason.contains("beens"), "{reason}");
        let reason = scans(&text.replace("point_cloud2", "image")).expect_err("unknown");
        assert!(
            reason.contains("image") && reason.contains("point_cloud2"),
            "{reason}"
        );
    }

    #[test]
    fn a_robot_without_id_or_twice_is_refused() {
        assert!(refusal("[[robot]]\nmodel = \"bicycle\"\nwheelbase_m = 1.0").contains("`id`"));
        let robot = "[[robot]]\nid = \"a\"\nmodel = \"bicycle\"\nwheelbase_m = 1.0\n";
        assert!(refusal(&robot.repeat(2)).contains("robot a is configured twice"));
    }

    #[test]
    fn a_robots_configuration_survives_json() {
        let config = Config::parse(WHOLE).expect("documented");
        let robot = &config.robots.first().expect("one robot").config;
        let json = serde_json::to_string(robot).expect("json");
        assert_eq!(
            &serde_json::from_str::<RobotConfig>(&json).expect("same"),
            robot
        );
    }
}
