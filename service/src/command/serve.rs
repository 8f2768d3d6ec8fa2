//! `fleetcal serve`: the service, until it is told to stop.

use std::ffi::OsString;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use fleetcal_clock::SharedClock;
use fleetcal_cluster::InstanceId;
use fleetcal_command::output::print_text;
use fleetcal_command::signals::Signals;
use fleetcal_config::Config;
use fleetcal_http::PublicUrl;
use fleetcal_proto::endpoint;

use crate::command::CommandError;
use crate::command::stopping::stop_in_time;
use crate::database::DatabaseArguments;
use crate::service::Service;

/// Parses an instance and its URL.
fn peer(text: &str) -> Result<(InstanceId, PublicUrl), String> {
    let (name, url) = text
        .split_once('=')
        .ok_or_else(|| "expected NAME=URL".to_owned())?;
    let name = InstanceId::parse(name).map_err(|refused| refused.to_string())?;
    Ok((name, PublicUrl::try_from(url.to_owned())?))
}

/// Explanation below the flags of `fleetcal serve --help`.
const LONG_HELP: &str = "\
Exit status: 0 told to stop, 2 wrong flags or files, 74 reading, writing or listening failed, or the \
service was told to stop while rows waited that it could not write: how many is logged. 130 ended by \
a second signal.";

/// Arguments of `fleetcal serve`. A flag has precedence over the file.
#[derive(Debug, Args)]
#[command(after_long_help = LONG_HELP)]
pub struct Arguments {
    /// A `fleetcal.toml`
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Folder of the signing key, and of the database unless --database names another
    /// [default: fleetcal-data]
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    #[command(flatten)]
    database: DatabaseArguments,
    /// Address of the API and the dashboard [default: 127.0.0.1:8080]
    #[arg(long, value_name = "ADDR")]
    pub http: Option<SocketAddr>,
    /// Address under which people reach the dashboard, such as <https://fleetcal.example.com>
    /// [default: the address of --http]
    #[arg(long, value_name = "URL")]
    pub public_url: Option<PublicUrl>,
    /// Zenoh endpoint to listen on; may be repeated [default: tcp/127.0.0.1:7447]
    #[arg(short = 'l', long, value_name = "ENDPOINT", value_parser = endpoint::parse)]
    pub listen: Vec<String>,
    /// Zenoh router to connect to; may be repeated
    #[arg(short = 'e', long, value_name = "ENDPOINT", value_parser = endpoint::parse)]
    pub connect: Vec<String>,
    /// A native Zenoh configuration (.json5, .json, .yaml), used instead of the embedded router
    /// with its access list; --listen and --connect replace its endpoints, and QUIC endpoints are
    /// set to one stream
    #[arg(short = 'c', long, env = "ZENOH_CONFIG", value_name = "FILE")]
    pub zenoh_config: Option<PathBuf>,
    /// Name of this process as one instance of several on the same --database
    #[arg(long, value_name = "NAME", value_parser = InstanceId::parse)]
    pub instance: Option<InstanceId>,
    /// Another instance, as NAME=URL, which answers for its own robots; may be repeated
    #[arg(long, value_name = "NAME=URL", value_parser = peer)]
    pub peer: Vec<(InstanceId, PublicUrl)>,
    /// Lets other instances be contacted without TLS: anybody on the network can read the traffic
    #[arg(long)]
    pub plaintext_peers: bool,
    /// Lets everybody who reaches a Zenoh endpoint beyond this machine connect without password or
    /// certificate: any of them can impersonate any robot, and stop all others' data
    #[arg(long)]
    pub allow_anonymous: bool,
}

impl Arguments {
    /// Returns its Zenoh endpoints, and the file that names them; empty if the configuration is
    /// invalid: `serve` reports that on start.
    pub fn zenoh(&self) -> Vec<OsString> {
        self.config().map_or_else(
            |_| Vec::new(),
            |config| {
                let endpoints = config.listen.into_iter().chain(config.connect);
                let file = config.zenoh_config.map(PathBuf::into_os_string);
                endpoints.map(OsString::from).chain(file).collect()
            },
        )
    }

    fn config(&self) -> Result<Config, CommandError> {
        let mut config = self
            .config
            .as_deref()
            .map(Config::read)
            .transpose()?
            .unwrap_or_default();
        if let Some(data) = &self.data {
            config.data.clone_from(data);
        }
        self.database.put_into(&mut config)?;
        if let Some(http) = self.http {
            config.http = http;
        }
        if let Some(url) = &self.public_url {
            config.public_url = Some(url.clone());
        }
        // What the file's own endpoints say does not count for a native configuration.
        if let Some(path) = &self.zenoh_config {
            config.zenoh_config = Some(path.clone());
        }
        config.allow_anonymous |= self.allow_anonymous;
        if let Some(instance) = &self.instance {
            config.cluster.instance = Some(instance.clone());
        }
        config.cluster.plaintext_peers |= self.plaintext_peers;
        config.cluster.peers.extend(self.peer.iter().cloned());
        config.cluster.check().map_err(CommandError::Cluster)?;
        if config.zenoh_config.is_some() {
            config.listen = Vec::new();
            config.connect = Vec::new();
        }
        if !self.listen.is_empty() {
            config.listen.clone_from(&self.listen);
        }
        if !self.connect.is_empty() {
            config.connect.clone_from(&self.connect);
        }
        Ok(config)
    }
}

/// Runs until SIGTERM or SIGINT.
///
/// # Errors
/// The configuration is refused, the service cannot be started, or it ends with rows that it could
/// not store.
pub async fn run(arguments: &Arguments, clock: SharedClock) -> Result<(), CommandError> {
    let config = arguments.config()?;
    let mut signals = Signals::listen()?;
    let zenoh = config.zenoh_config.as_ref();
    let zenoh = zenoh.map_or_else(
        || config.listen.join(" "),
        |path| path.display().to_string(),
    );
    let service = Service::start(config, Arc::clone(&clock)).await?;
    let http = service.http_address();
    tracing::info!(%http, zenoh, "fleetcal is ready: http://{http}");
    if let Some(link) = service.setup_link() {
        // Not into the log, which others may read.
        print_text(&format!("set up at {link}\n"))?;
    }
    signals.stop().await;
    tracing::info!("stopping");
    stop_in_time(service, signals).await?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;

    #[derive(Debug, clap::Parser)]
    struct Line {
        #[command(flatten)]
        arguments: Arguments,
    }

    #[test]
    fn the_zenoh_file_of_a_configuration_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let config = folder.path().join("a.toml");
        std::fs::write(&config, "zenoh_config = \"/etc/fleetcal/service.json5\"\n").unwrap();
        let line = ["serve", "--config", config.to_str().unwrap()];
        let named = Line::parse_from(line).arguments.zenoh();
        assert_eq!(named, ["/etc/fleetcal/service.json5"]);
        let line = ["serve", "--listen", "tls/0.0.0.0:7447"];
        let named = Line::parse_from(line).arguments.zenoh();
        assert_eq!(named, ["tls/0.0.0.0:7447"]);
    }
}
