//! The flags by which a robot's side reaches the service, as Zenoh's own tools have them.

use std::path::PathBuf;

use clap::Args;
use fleetcal_proto::endpoint;
use fleetcal_robot::Connection;

/// Endpoints and configuration of the connection.
#[derive(Debug, Args)]
pub struct ConnectionArguments {
    /// The service's Zenoh endpoint, `tcp/192.0.2.1:7447`; may be repeated, and the first that
    /// answers is used
    #[arg(
        short = 'e',
        long,
        value_name = "ENDPOINT",
        value_parser = endpoint::parse,
        required_unless_present = "zenoh_config"
    )]
    pub connect: Vec<String>,
    /// A native Zenoh configuration (.json5, .json, .yaml), in which QUIC endpoints are set to one
    /// stream; --connect replaces its endpoints
    #[arg(short = 'c', long, env = "ZENOH_CONFIG", value_name = "FILE")]
    pub zenoh_config: Option<PathBuf>,
}

impl ConnectionArguments {
    /// Returns the connection that the flags describe.
    pub fn connection(&self) -> Connection {
        Connection {
            endpoints: self.connect.clone(),
            zenoh_config: self.zenoh_config.clone(),
        }
    }
}
