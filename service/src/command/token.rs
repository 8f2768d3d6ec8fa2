//! `fleetcal token`: API tokens, with the database at hand.

use std::time::Duration;

use clap::{Args, Subcommand};
use fleetcal_clock::SharedClock;
use fleetcal_command::output::print_text;
use fleetcal_domain::access::{AccountName, Actor, Grant, Role, TokenState, TokenValue};
use fleetcal_domain::limits;
use fleetcal_model::{TokenId, WallTime};
use fleetcal_operations::accounts::{ChangeToken, TokenChange};
use fleetcal_operations::entropy;
use fleetcal_proto::RobotId;
use fleetcal_store::TokenRecord;
use jiff::{Span, SpanRelativeTo, Timestamp, Unit};

use crate::command::CommandError;
use crate::database::Place;

/// Arguments of `fleetcal token`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The action.
    #[command(subcommand)]
    pub action: Action,
}

/// Actions on tokens.
#[derive(Debug, Subcommand)]
pub enum Action {
    /// Creates a token and prints it alone on standard output; it is not shown again
    Create(Create),
    /// Lists the tokens
    List(Place),
    /// Revokes a token
    Revoke(Revoke),
}

/// Arguments of `fleetcal token create`.
#[derive(Debug, Args)]
pub struct Create {
    /// Place of the records
    #[command(flatten)]
    pub place: Place,
    /// viewer, operator, approver, admin or robot
    #[arg(long, value_parser = role)]
    pub role: Role,
    /// The name that the audit shows for its requests
    #[arg(long)]
    pub name: String,
    /// The robot, for a token of role robot
    #[arg(long, value_name = "ID")]
    pub robot: Option<RobotId>,
    /// Validity, such as 30d or 12h [default: unlimited]
    #[arg(long, value_name = "SPAN", value_parser = validity)]
    pub expires: Option<Duration>,
}

/// Arguments of `fleetcal token revoke`.
#[derive(Debug, Args)]
pub struct Revoke {
    /// Place of the records
    #[command(flatten)]
    pub place: Place,
    /// Its number in `fleetcal token list`
    #[arg(value_name = "NUMBER")]
    pub id: TokenId,
}

/// Parses the role of a name on the command line.
pub(super) fn role(name: &str) -> Result<Role, String> {
    Role::parse(name).ok_or_else(|| {
        let accepted: Vec<&str> = Role::ALL.iter().map(|one| one.as_str()).collect();
        let accepted = accepted.join(", ");
        format!("role: got {name:?}, expected one of {accepted}")
    })
}

fn validity(text: &str) -> Result<Duration, String> {
    span(text, limits::TOKEN_EXPIRES_MAX)
}

/// Parses a span of time up to `max`, with days of 24 hours.
pub(super) fn span(text: &str, max: Duration) -> Result<Duration, String> {
    let seconds = text.parse::<Span>().ok().and_then(|span| {
        span.total((Unit::Second, SpanRelativeTo::days_are_24_hours()))
            .ok()
    });
    seconds
        .and_then(|seconds| Duration::try_from_secs_f64(seconds).ok())
        .filter(|span| !span.is_zero() && *span <= max)
        .ok_or_else(|| {
            let days = max.as_secs() / 86_400;
            format!("{text:?} is not accepted; give up to {days} days, such as 30d or 12h")
        })
}

/// Runs the action.
///
/// # Errors
/// The database cannot be used, or the token is refused.
pub async fn run(arguments: &Arguments, clock: SharedClock) -> Result<(), CommandError> {
    let now = clock.now();
    match &arguments.action {
        Action::Create(create) => self::create(create, now).await,
        Action::List(place) => list(place, now).await,
        Action::Revoke(revoke) => self::revoke(revoke, now).await,
    }
}

async fn create(arguments: &Create, now: WallTime) -> Result<(), CommandError> {
    let value = TokenValue::new(&entropy::secret()?);
    let change = TokenChange::Create {
        name: AccountName::parse(&arguments.name)?,
        grant: Grant::of_token(arguments.role, arguments.robot.clone())?,
        hash: value.hash(),
        expires_ns: arguments.expires.map(|span| now.plus(span)),
        key: None,
    };
    let mut database = arguments.place.administration().await?;
    database.transact(asked(now, change)).await?;
    database.close().await?;
    Ok(print_text(&format!("{}\n", value.reveal()))?)
}

async fn revoke(arguments: &Revoke, now: WallTime) -> Result<(), CommandError> {
    let change = TokenChange::Revoke { id: arguments.id };
    let mut database = arguments.place.administration().await?;
    database.transact(asked(now, change)).await?;
    database.close().await?;
    Ok(())
}

/// Makes a change at the request of the command line.
fn asked(now: WallTime, change: TokenChange) -> ChangeToken {
    ChangeToken {
        actor: Actor::command_line(),
        now,
        change,
    }
}

async fn list(place: &Place, now: WallTime) -> Result<(), CommandError> {
    let database = place.administration().await?;
    let tokens = database.tokens().await?;
    database.close().await?;
    let rows: String = tokens.iter().map(|token| row(token, now)).collect();
    Ok(print_text(&format!(
        "{:>6}  {:<9}  {:<9}  {:<20}  {:<20}  NAME\n{rows}",
        "NUMBER", "ROLE", "STATE", "EXPIRES", "LAST USED"
    ))?)
}

fn row(token: &TokenRecord, now: WallTime) -> String {
    let state = match token.state(now) {
        TokenState::Valid => "valid",
        TokenState::Expired => "expired",
        TokenState::Revoked => "revoked",
    };
    let robot = token.grant.robot();
    let robot = robot.map_or_else(String::new, |id| format!(" (robot {id})"));
    format!(
        "{:>6}  {:<9}  {:<9}  {:<20}  {:<20}  {}{robot}\n",
        token.id,
        token.grant.role().as_str(),
        state,
        time(token.span.expires_ns),
        time(token.used_ns),
        token.name
    )
}

/// Formats a time in a list, to the second.
pub(super) fn time(wall: Option<WallTime>) -> String {
    wall.and_then(|wall| Timestamp::from_second(wall.whole_s()).ok())
        .map_or_else(|| "never".to_owned(), |time| time.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_are_read_with_their_unit() {
        assert_eq!(validity("30d"), Ok(Duration::from_hours(720)));
        assert_eq!(validity("12h"), Ok(Duration::from_hours(12)));
        for refused in ["", "30", "d", "-1d", "0s", "10000d", "1 month"] {
            assert!(validity(refused).is_err(), "{refused}");
        }
    }

    #[test]
    fn a_time_that_never_was_is_never() {
        assert_eq!(time(None), "never");
        assert_eq!(
            time(Some(WallTime(1_767_225_600_500_000_000))),
            "2026-01-01T00:00:00Z"
        );
    }
}
