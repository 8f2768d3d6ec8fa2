//! A service that is alone, hears what the cluster's robots send, and says nothing: its estimators are
//! what the cluster's have to be, to the bit.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;

use fleetcal_clock::SystemClock;
use fleetcal_contract::own_server::psql;
use fleetcal_fleet::estimator_of;
use fleetcal_model::Parameter;
use fleetcal_tests::http;
use serde_json::{Value, json};

use crate::cluster::{Cluster, token_in};
use crate::process::Process;

/// Stored estimator of each robot.
pub type States = BTreeMap<String, Vec<u8>>;

/// Published sigmas of each robot: of its steering offset and of its LiDAR's mount, rad and m.
pub type Sigmas = BTreeMap<String, Vec<f64>>;

/// Parameters of a calibration.
pub const CALIBRATED: [Parameter; 4] = [
    Parameter::SteeringOffset,
    Parameter::LidarX,
    Parameter::LidarY,
    Parameter::LidarYaw,
];

/// Service beside a cluster; see the module.
#[derive(Debug)]
pub struct Twin {
    process: Process,
    http: SocketAddr,
    token: String,
    data: PathBuf,
}

impl Twin {
    /// Starts it at the first router of a cluster, with a database of its own.
    pub fn start(cluster: &Cluster) -> Self {
        let mute = json!({
            "enabled": true,
            "default_permission": "allow",
            "rules": [{
                "id": "mute",
                "messages": ["put", "delete", "declare_queryable"],
                "flows": ["egress"],
                "permission": "deny",
                "key_exprs": ["fleet/**"],
            }],
            "subjects": [{"id": "all"}],
            "policies": [{"rules": ["mute"], "subjects": ["all"]}],
        });
        let (process, http, data) = cluster.start_beside("twin", &[("access_control", mute)]);
        let token = token_in(&["--data", data.to_str().unwrap()], "reader");
        Self {
            process,
            http,
            token,
            data,
        }
    }

    /// Returns the sigmas that it would publish.
    pub fn sigmas(&self, robots: &[String]) -> Sigmas {
        sigmas(robots, |path| {
            let answer = http::get(self.http, path, Some(&self.token)).unwrap();
            assert_eq!(answer.status, 200, "{path}: {}", answer.body);
            serde_json::from_str(&answer.body).unwrap()
        })
    }

    /// Ends it; returns its robots' states.
    pub async fn end(mut self) -> States {
        self.process.end_in_order();
        let store = fleetcal_sqlite::open(&self.data, Arc::new(SystemClock::start())).await;
        let store = store.unwrap();
        let stored = store.load_checkpoints().await.unwrap().into_iter();
        let states = stored
            .map(|one| (one.robot.to_string(), estimator_of(&one.state).unwrap()))
            .collect();
        store.close().await.unwrap();
        states
    }
}

/// Returns the sigmas of robots in the API that `get` queries.
pub fn sigmas(robots: &[String], get: impl Fn(&str) -> Value) -> Sigmas {
    let of = |robot: &String| {
        let estimate = get(&format!("/api/v1/robots/{robot}/estimate"));
        let sigma = |one: Parameter| {
            estimate["parameters"][one.name()]["sigma"]
                .as_f64()
                .unwrap()
        };
        (robot.clone(), CALIBRATED.map(sigma).to_vec())
    };
    robots.iter().map(of).collect()
}

/// Returns the states of a cluster's robots, as the last instance has stored them.
pub fn states(cluster: &Cluster) -> States {
    let told = psql(
        &cluster.records(),
        "SELECT r.id, encode(c.state, 'hex') FROM checkpoint AS c JOIN robot AS r ON r.key = c.robot",
    );
    let byte = |hex: &[u8]| u8::from_str_radix(str::from_utf8(hex).unwrap(), 16).unwrap();
    let state = |line: &str| {
        let (robot, hex) = line.split_once('|')?;
        let bytes: Vec<u8> = hex.as_bytes().chunks(2).map(byte).collect();
        Some((robot.to_owned(), estimator_of(&bytes).unwrap()))
    };
    told.lines().filter_map(state).collect()
}
