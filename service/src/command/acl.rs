//! `fleetcal acl generate`: a router's configuration in which each robot has its own keys alone.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand, ValueEnum};
use fleetcal_command::output::print_text;
use fleetcal_config::Config;
use fleetcal_link::{Identity, RouterCertificate, StrictRouter, is_robots_own};
use fleetcal_proto::{KeyRoot, Keys, RobotId, endpoint};

use crate::command::{CommandError, passwords};

/// Bit of a mode by which everybody may read.
const READABLE_BY_ALL: u32 = 0o004;

/// Explanation of the printed configuration.
const LONG_HELP: &str = "\
Prints a native Zenoh configuration of a router: deny by default, and for each robot what it sends, \
asks for and hears, on its own keys alone. A robot is known by the name it connects under, which is \
its id: the common name of its certificate, or its user.

  the service's own router   fleetcal acl generate ... > router.json5; fleetcal serve -c router.json5
  a router before it         fleetcal acl generate --service fleetcal ... > router.json5; \
zenohd -c router.json5

Zenoh reads the list when the router starts: for one more robot, generate it again and restart.";

/// Arguments of `fleetcal acl`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The action.
    #[command(subcommand)]
    pub action: Action,
}

/// Actions on access lists.
#[derive(Debug, Subcommand)]
pub enum Action {
    /// Prints a router's configuration with an access list per robot
    Generate(GenerateArguments),
}

/// Way in which a router identifies its peers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum IdentityName {
    /// Common name of the certificate (mTLS).
    Certificate,
    /// User and password.
    User,
}

/// Arguments of `fleetcal acl generate`.
#[derive(Debug, Args)]
#[command(after_long_help = LONG_HELP)]
pub struct GenerateArguments {
    /// A robot; may be repeated
    #[arg(long, value_name = "ID", value_parser = RobotId::parse)]
    pub robot: Vec<RobotId>,
    /// A `fleetcal.toml` whose robots and root are used too
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Identification of robots and service
    #[arg(long, value_enum, default_value = "certificate")]
    pub identity: IdentityName,
    /// The router's certificate, PEM
    #[arg(long, value_name = "FILE", requires = "tls_key")]
    pub tls_certificate: Option<PathBuf>,
    /// The key of the router's certificate, PEM
    #[arg(long, value_name = "FILE", requires = "tls_certificate")]
    pub tls_key: Option<PathBuf>,
    /// The authority that signed the certificates of robots and service, PEM
    #[arg(long, value_name = "FILE", requires = "tls_certificate")]
    pub tls_ca: Option<PathBuf>,
    /// The file with the passwords, `user:password` in each line; a missing file is created, and
    /// missing passwords are added
    #[arg(long, value_name = "FILE", conflicts_with = "tls_ca")]
    pub passwords: Option<PathBuf>,
    /// Name under which the service connects, for an external router
    #[arg(long, value_name = "NAME", value_parser = RobotId::parse)]
    pub service: Option<RobotId>,
    /// A further key expression on which each robot may publish, with {robot} for its id, such as
    /// `*/{robot}/scan/**`; may be repeated
    #[arg(long, value_name = "KEYEXPR")]
    pub stream: Vec<String>,
    /// An endpoint that the router listens on; may be repeated [default: tls/0.0.0.0:7447, without
    /// certificate tcp/0.0.0.0:7447]
    #[arg(short = 'l', long, value_name = "ENDPOINT", value_parser = endpoint::parse)]
    pub listen: Vec<String>,
    /// Another router of the fleet, by the common name of its certificate: all messages that
    /// entered there pass; may be repeated
    #[arg(long, value_name = "NAME", requires = "tls_ca")]
    pub router: Vec<String>,
    /// An endpoint of another router; may be repeated
    #[arg(short = 'e', long, value_name = "ENDPOINT", requires = "router", value_parser = endpoint::parse)]
    pub connect: Vec<String>,
    /// First chunk of every key [default: fleet, or from --config]
    #[arg(long, value_name = "CHUNK", value_parser = KeyRoot::parse)]
    pub root: Option<KeyRoot>,
}

/// Prints the configuration.
///
/// # Errors
/// Without a named robot, for a stream that is every robot's, or for a refused configuration.
pub fn run(arguments: &Arguments) -> Result<(), CommandError> {
    let Action::Generate(arguments) = &arguments.action;
    let router = router(arguments)?;
    if let Identity::User { passwords } = &router.identity {
        let peers = router.robots.iter().map(RobotId::as_str);
        let added = passwords::complete(passwords, peers.chain(router.service.as_deref()))?;
        if !added.is_empty() {
            eprintln!(
                "fleetcal: {} has a new password for {}: each connects with its name as the user",
                passwords.display(),
                added.join(", ")
            );
        }
        if is_readable_by_all(passwords) {
            eprintln!(
                "fleetcal: {} can be read by everybody on this machine, who then can be any robot: \
                 chmod o-r",
                passwords.display()
            );
        }
    }
    let names: Vec<&str> = router.robots.iter().map(RobotId::as_str).collect();
    let text = format!(
        "// A Zenoh router that lets each of these robots use its own keys alone: {}.\n\
         // Made by `fleetcal acl generate`; read when the router starts.\n{:#}\n",
        names.join(", "),
        router.configuration(),
    );
    Ok(print_text(&text)?)
}

fn router(arguments: &GenerateArguments) -> Result<StrictRouter, CommandError> {
    let file = arguments.config.as_deref().map(Config::read).transpose()?;
    let file = file.unwrap_or_default();
    let configured = file.robots.iter().map(|entry| entry.id.clone());
    let robots: BTreeSet<RobotId> = arguments.robot.iter().cloned().chain(configured).collect();
    if robots.is_empty() {
        return Err(CommandError::NoRobots);
    }
    if let Some(service) = &arguments.service
        && robots.contains(service)
    {
        return Err(CommandError::ServiceIsRobot(service.clone()));
    }
    let is_robot = |name: &&String| robots.iter().any(|robot| robot.as_str() == name.as_str());
    if let Some(router) = arguments.router.iter().find(is_robot) {
        return Err(CommandError::RouterIsRobot(router.clone()));
    }
    let keys = Keys::new(arguments.root.clone().unwrap_or(file.root));
    // A robot of the root's name would have every robot's keys by a stream that begins with it.
    let of_root = robots
        .iter()
        .any(|robot| robot.as_str() == keys.root().as_str());
    let everybodys = |stream: &&String| of_root || !is_robots_own(stream);
    if let Some(stream) = arguments.stream.iter().find(everybodys) {
        return Err(CommandError::StreamOfAll(stream.clone()));
    }
    let certificate = match (&arguments.tls_certificate, &arguments.tls_key) {
        (Some(certificate), Some(key)) => Some(RouterCertificate {
            certificate: certificate.clone(),
            key: key.clone(),
            ca: arguments.tls_ca.clone(),
        }),
        _ => None,
    };
    let listen = match (arguments.listen.as_slice(), &certificate) {
        ([], Some(_)) => vec!["tls/0.0.0.0:7447".to_owned()],
        ([], None) => vec!["tcp/0.0.0.0:7447".to_owned()],
        (given, _) => given.to_vec(),
    };
    Ok(StrictRouter {
        keys,
        robots,
        service: arguments.service.as_ref().map(RobotId::to_string),
        streams: arguments.stream.clone(),
        identity: identity(arguments)?,
        certificate,
        listen,
        routers: arguments.router.clone(),
        connect: arguments.connect.clone(),
    })
}

/// True if everybody may read a file.
fn is_readable_by_all(path: &Path) -> bool {
    let mode = fs::metadata(path).map(|file| file.permissions().mode());
    mode.is_ok_and(|mode| mode & READABLE_BY_ALL != 0)
}

/// Returns the identification of robots and service, once all its parts are present.
fn identity(arguments: &GenerateArguments) -> Result<Identity, CommandError> {
    match (arguments.identity, &arguments.passwords, &arguments.tls_ca) {
        (IdentityName::Certificate, None, Some(_)) => Ok(Identity::Certificate),
        (IdentityName::User, Some(passwords), _) => Ok(Identity::User {
            passwords: passwords.clone(),
        }),
        (IdentityName::Certificate, ..) => Err(CommandError::Identity {
            identity: "certificate",
            needs: "--tls-certificate, --tls-key and --tls-ca, and no --passwords",
        }),
        (IdentityName::User, ..) => Err(CommandError::Identity {
            identity: "user",
            needs: "--passwords",
        }),
    }
}
