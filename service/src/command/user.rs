//! `fleetcal user`: people who sign in, with the database at hand.

use std::io::{BufRead as _, IsTerminal as _, Write as _};

use clap::{Args, Subcommand};
use fleetcal_clock::SharedClock;
use fleetcal_command::output::print_text;
use fleetcal_domain::access::{AccountName, Actor, Grant, Password, PasswordHash, Role};
use fleetcal_model::WallTime;
use fleetcal_operations::accounts::{ChangeUser, UserChange, UserEdit};
use fleetcal_operations::entropy;
use fleetcal_store::{Expected, UserRecord};
use rustix::termios::{LocalModes, OptionalActions, tcgetattr, tcsetattr};

use crate::command::CommandError;
use crate::command::token::{role, time};
use crate::database::Place;

/// Arguments of `fleetcal user`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The action.
    #[command(subcommand)]
    pub action: Action,
}

/// Actions on users.
#[derive(Debug, Subcommand)]
pub enum Action {
    /// Creates a user; prompts for the password, or reads it from standard input
    Create(Create),
    /// Lists the users
    List(Place),
    /// Sets a user's password and ends the user's sessions; prompts for it, or reads standard input
    Password(Named),
    /// Disables a user and ends the user's sessions
    Disable(Named),
}

/// Arguments of `fleetcal user create`.
#[derive(Debug, Args)]
pub struct Create {
    /// Place of the records
    #[command(flatten)]
    pub place: Place,
    /// viewer, operator, approver or admin
    #[arg(long, value_parser = role)]
    pub role: Role,
    /// The user name
    #[arg(long)]
    pub name: String,
}

/// A user.
#[derive(Debug, Args)]
pub struct Named {
    /// Place of the records
    #[command(flatten)]
    pub place: Place,
    /// The user's name
    #[arg(long)]
    pub name: String,
}

/// Runs the action.
///
/// # Errors
/// The database cannot be used, or name or password are refused.
pub async fn run(arguments: &Arguments, clock: SharedClock) -> Result<(), CommandError> {
    let now = clock.now();
    match &arguments.action {
        Action::Create(create) => {
            let change = UserChange::Create {
                name: AccountName::parse(&create.name)?,
                grant: Grant::of_person(create.role)?,
                password: asked_for()?,
                key: None,
            };
            let mut database = create.place.administration().await?;
            database.transact(asked(now, change)).await?;
            database.close().await?;
            Ok(())
        }
        Action::List(place) => list(place).await,
        Action::Password(named) => {
            let edit = UserEdit {
                password: Some(asked_for()?),
                ..UserEdit::default()
            };
            self::edit(named, edit, now).await
        }
        Action::Disable(named) => {
            let edit = UserEdit {
                disabled: Some(true),
                ..UserEdit::default()
            };
            self::edit(named, edit, now).await
        }
    }
}

async fn edit(named: &Named, edit: UserEdit, now: WallTime) -> Result<(), CommandError> {
    let mut database = named.place.administration().await?;
    let user = database.user_named(&named.name).await?;
    let user = user.ok_or_else(|| CommandError::UserUnknown(named.name.clone()))?;
    let change = UserChange::Edit {
        id: user.id,
        expected: Expected::Version(user.version),
        edit,
        keep: None,
    };
    database.transact(asked(now, change)).await?;
    database.close().await?;
    Ok(())
}

/// Makes a change at the request of the command line.
fn asked(now: WallTime, change: UserChange) -> ChangeUser {
    ChangeUser {
        actor: Actor::command_line(),
        now,
        change,
    }
}

async fn list(place: &Place) -> Result<(), CommandError> {
    let database = place.administration().await?;
    let users = database.users().await?;
    database.close().await?;
    let rows: String = users.iter().map(row).collect();
    Ok(print_text(&format!(
        "{:<9}  {:<8}  {:<20}  NAME\n{rows}",
        "ROLE", "STATE", "LAST SIGNED IN"
    ))?)
}

fn row(user: &UserRecord) -> String {
    let state = if user.disabled { "disabled" } else { "enabled" };
    format!(
        "{:<9}  {state:<8}  {:<20}  {}\n",
        user.grant.role().as_str(),
        time(user.signed_in_ns),
        user.name
    )
}

/// Returns the hash of a password that is typed, twice and unseen, or is the first line of standard
/// input.
fn asked_for() -> Result<PasswordHash, CommandError> {
    let typed = if std::io::stdin().is_terminal() {
        let first = unseen("Password: ")?;
        if unseen("Once more: ")? != first {
            return Err(CommandError::PasswordsDiffer);
        }
        first
    } else {
        line()?
    };
    Ok(PasswordHash::of(
        &Password::parse(&typed)?,
        &entropy::salt()?,
    )?)
}

/// Reads a line that is typed without being shown.
fn unseen(prompt: &str) -> Result<String, std::io::Error> {
    let mut stderr = std::io::stderr();
    stderr.write_all(prompt.as_bytes())?;
    stderr.flush()?;
    let stdin = std::io::stdin();
    let shown = tcgetattr(&stdin)?;
    let mut hidden = shown.clone();
    hidden.local_modes.remove(LocalModes::ECHO);
    tcsetattr(&stdin, OptionalActions::Flush, &hidden)?;
    let typed = line();
    tcsetattr(&stdin, OptionalActions::Flush, &shown)?;
    stderr.write_all(b"\n")?;
    typed
}

/// Reads a line of standard input, without its end.
fn line() -> Result<String, std::io::Error> {
    let mut line = String::new();
    std::io::stdin().lock().read_line(&mut line)?;
    Ok(line.trim_end_matches(['\r', '\n']).to_owned())
}
