//! `fleetcal support`: the support bundle of a robot, from a running service.

use std::path::PathBuf;

use clap::Args;
use fleetcal_command::output::print_text;
use fleetcal_operations::api_client::ApiClient;
use fleetcal_proto::RobotId;
use serde::Deserialize;
use tokio::fs::{self, File};

use crate::command::CommandError;

/// Environment variable that has the token where no file is given.
const TOKEN: &str = "FLEETCAL_TOKEN";

/// Arguments of `fleetcal support`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  FLEETCAL_TOKEN=cal_... fleetcal support tugger_01
  fleetcal support tugger_01 --url https://fleetcal.example.com --token-file token.txt --list")]
pub struct Arguments {
    /// The robot
    #[arg(value_parser = RobotId::parse)]
    pub robot: RobotId,
    /// Address of the service
    #[arg(long, value_name = "URL", default_value = "http://127.0.0.1:8080")]
    pub url: String,
    /// File with the API token of an operator; the variable `FLEETCAL_TOKEN` unless given
    #[arg(long, value_name = "FILE")]
    pub token_file: Option<PathBuf>,
    /// Certificates of the authorities to trust, PEM; the machine's unless given
    #[arg(long, value_name = "FILE")]
    pub authorities: Option<PathBuf>,
    /// Lets the token be sent to another machine without TLS: anybody on the network can read it
    #[arg(long)]
    pub plaintext: bool,
    /// The archive to write; ROBOT-support.zip unless given. An existing file is replaced when the
    /// new one is complete
    #[arg(long, value_name = "FILE")]
    pub to: Option<PathBuf>,
    /// Only list what the bundle has
    #[arg(long)]
    pub list: bool,
}

/// Files of a bundle, as the API lists them.
#[derive(Debug, Deserialize)]
struct List {
    files: Vec<Listed>,
}

/// File of a bundle.
#[derive(Debug, Deserialize)]
struct Listed {
    name: String,
    bytes: u64,
}

/// Lists a robot's bundle, then writes it.
///
/// # Errors
/// There is no token, the service cannot be reached or refuses, or the file cannot be written.
pub async fn run(arguments: &Arguments) -> Result<(), CommandError> {
    let token = token(arguments)?;
    let authorities = arguments.authorities.as_deref();
    let service = ApiClient::new(&arguments.url, &token, authorities, arguments.plaintext)?;
    let path = format!("/robots/{}/support", arguments.robot);
    let document = service.document(&format!("{path}?list=true")).await?;
    let list: List = serde_json::from_slice(&document)
        .map_err(|error| CommandError::Support(error.to_string()))?;
    for Listed { name, bytes } in &list.files {
        print_text(&format!("{bytes:>12}  {name}\n"))?;
    }
    if arguments.list {
        return Ok(());
    }
    let default = || PathBuf::from(format!("{}-support.zip", arguments.robot));
    let to = arguments.to.clone().unwrap_or_else(default);
    let mut part = to.clone().into_os_string();
    part.push(".part");
    let written = save(&service, &path, &PathBuf::from(&part)).await;
    let bytes = match written {
        Ok(bytes) => bytes,
        Err(error) => {
            // What there is of it is of no use; that it may be gone already changes nothing.
            fs::remove_file(&part).await.ok();
            return Err(error);
        }
    };
    fs::rename(&part, &to).await?;
    print_text(&format!("{bytes:>12}  written to {}\n", to.display()))?;
    Ok(())
}

async fn save(service: &ApiClient, path: &str, part: &PathBuf) -> Result<u64, CommandError> {
    let mut file = File::create(part).await?;
    let bytes = service.save(path, &mut file).await?;
    file.sync_all().await?;
    Ok(bytes)
}

/// Returns the token, which is no argument: arguments are visible to everybody on the machine.
fn token(arguments: &Arguments) -> Result<String, CommandError> {
    let token = match &arguments.token_file {
        Some(path) => std::fs::read_to_string(path)?,
        None => std::env::var(TOKEN).unwrap_or_default(),
    };
    let token = token.trim();
    if token.is_empty() {
        return Err(CommandError::NoToken);
    }
    Ok(token.to_owned())
}
