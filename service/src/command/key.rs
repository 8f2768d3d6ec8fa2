//! `fleetcal key`: the key that the service signs with.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::{Args, Subcommand};
use fleetcal_clock::SharedClock;
use fleetcal_command::output::print_text;
use fleetcal_domain::limits;
use fleetcal_folder::signing_key::{KEY_FILE, changes_of, rotate};
use fleetcal_operations::entropy;

use super::token::span;
use crate::command::CommandError;

/// Explanation below the flags of `fleetcal key rotate --help`.
const LONG_HELP: &str = "\
The service signs with the new key from its next start on, and announces the change, signed with the \
former key, to every agent that asks. Agents take the new key over, also those that come back later, \
and accept the former one for the time of --accept-former-for more. After a theft of the former key \
this is not enough: start every agent with the new key as --service-key.

Of several instances on one database each needs both files, signing.key and signing.key.changes, \
before it starts again; one that starts with the former key after that is refused.";

/// Arguments of `fleetcal key`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The action.
    #[command(subcommand)]
    pub action: Action,
}

/// Actions on the key.
#[derive(Debug, Subcommand)]
pub enum Action {
    /// Replaces the signing key by a new one, which robots take over by themselves
    Rotate(Rotate),
}

/// Arguments of `fleetcal key rotate`.
#[derive(Debug, Args)]
#[command(after_long_help = LONG_HELP)]
pub struct Rotate {
    #[command(flatten)]
    place: KeyPlace,
    /// Time for which the former key is accepted beside the new one, such as 30d or 12h, from 1m
    /// to 366d, by the robot's clock from the moment at which it takes the new one over
    #[arg(long, value_name = "SPAN", default_value = "30d", value_parser = accepted_for)]
    pub accept_former_for: Duration,
}

/// Place of the key, by one of two flags.
#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
struct KeyPlace {
    /// The service's data folder
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// The key's own file, as `cluster.signing_key` names it
    #[arg(long, value_name = "FILE")]
    signing_key: Option<PathBuf>,
}

impl KeyPlace {
    fn file(&self) -> PathBuf {
        let data = self.data.as_deref().unwrap_or(Path::new("."));
        let file = self.signing_key.clone();
        file.unwrap_or_else(|| data.join(KEY_FILE))
    }
}

fn accepted_for(text: &str) -> Result<Duration, String> {
    let accepted = span(text, limits::FORMER_KEY_ACCEPTED_MAX)?;
    if accepted < limits::FORMER_KEY_ACCEPTED_MIN {
        let least_s = limits::FORMER_KEY_ACCEPTED_MIN.as_secs();
        return Err(format!("{text:?} is too short; give {least_s} s at least"));
    }
    Ok(accepted)
}

/// Runs the action.
///
/// # Errors
/// The key cannot be read or replaced.
pub fn run(arguments: &Arguments, clock: &SharedClock) -> Result<(), CommandError> {
    let Action::Rotate(arguments) = &arguments.action;
    let file = arguments.place.file();
    let draw = || entropy::secret().map_err(|error| std::io::Error::other(error.to_string()));
    let lasts = arguments.accept_former_for.as_secs();
    let lasts_s = u32::try_from(lasts).unwrap_or(u32::MAX);
    let new = rotate(&file, draw, clock.now(), lasts_s)?;
    let (file, changes) = (file.display(), changes_of(&file));
    Ok(print_text(&format!(
        "{file}: the new key is {new}, with the id {}\n\
         Keep {file} and {} in a safe place, copy both to each instance, and restart the service: it \
         signs with the new key from then on. Robots take it over when they reach the service, and \
         accept the former one for {lasts} s more.\n",
        new.id(),
        changes.display(),
    ))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_former_key_is_accepted_for_a_minute_at_least() {
        assert_eq!(accepted_for("1m"), Ok(Duration::from_mins(1)));
        assert_eq!(accepted_for("366d"), Ok(limits::FORMER_KEY_ACCEPTED_MAX));
        for refused in ["59s", "0s", "367d"] {
            assert!(accepted_for(refused).is_err(), "{refused}");
        }
    }
}
