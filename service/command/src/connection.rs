//! The flags by which a robot's side reaches the service, as Zenoh's own tools have them.

use std::path::PathBuf;

use clap::Args;
use fleetcal_robot::Connection;

/// Where to connect to.
#[derive(Debug, Args)]
pub struct ConnectionArguments {
    /// The service's Zenoh endpoint, `tcp/192.0.2.1:7447`; may be repeated, the first that answers
    /// is taken
    #[arg(
        short = 'e',
        long,
        value_name = "ENDPOINT",
        required_unless_present = "zenoh_config"
    )]
    pub connect: Vec<String>,
    /// A native Zenoh configuration (.json5, .json, .yaml), whose QUIC endpoints get one
    /// stream; --connect replaces the endpoints in it
    #[arg(short = 'c', long, env = "ZENOH_CONFIG", value_name = "FILE")]
    pub zenoh_config: Option<PathBuf>,
}

impl ConnectionArguments {
    /// What the flags say.
    pub fn connection(&self) -> Connection {
        Connection {
            endpoints: self.connect.clone(),
            zenoh_config: self.zenoh_config.clone(),
        }
    }
}
