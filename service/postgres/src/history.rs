//! Seconds of history in PostgreSQL: written many at once into partitions of a day, and rolled up
//! from there.
//!
//! A minute or an hour is made of all of its rows, at most
//! [`limits::POSTGRES_ROLL_UP_EVERY`] after one of them was written. What was not rolled up when
//! the service ended is found at the next start.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::LazyLock;

use fleetcal_domain::limits;
use fleetcal_model::{Parameter, WallTime};
use fleetcal_sql::{Connection as _, Keys, Statement, StatementError, key_of};
use fleetcal_store::{HistoryRow, StoreError};
use tokio::time::Instant;

use crate::connection::Session;
use crate::failure::Fate;

pub(crate) const DAY_S: i64 = 86_400;
const HOUR_S: i64 = 3_600;
const MINUTE_S: i64 = 60;
const NS_PER_S: i64 = 1_000_000_000;

/// Pending work of this process on the history.
#[derive(Debug)]
pub(crate) struct History {
    /// Days since the epoch whose partitions exist.
    days: BTreeSet<i64>,
    /// Minutes to be rolled up: robot's key and first second.
    minutes: BTreeSet<(i64, i64)>,
    rolled_up_at: Instant,
}

impl History {
    /// Makes a history without pending work.
    pub(crate) fn new() -> Self {
        Self {
            days: BTreeSet::new(),
            minutes: BTreeSet::new(),
            rolled_up_at: Instant::now(),
        }
    }

    /// Finds seconds that were not rolled up.
    ///
    /// # Errors
    /// The database's failure.
    pub(crate) async fn open(session: &mut Session) -> Result<Self, StoreError> {
        let mut history = Self::new();
        history.minutes = not_rolled_up(session, NOT_ROLLED_UP, None).await?;
        Ok(history)
    }

    /// Finds seconds of robots, by their keys, that were not rolled up.
    ///
    /// # Errors
    /// The database's failure.
    pub(crate) async fn not_rolled_up(
        session: &mut Session,
        robots: &[i64],
    ) -> Result<Written, StoreError> {
        let asked = format!("{NOT_ROLLED_UP} WHERE r.key = ANY($1)");
        Ok(Written {
            days: BTreeSet::new(),
            minutes: not_rolled_up(session, &asked, Some(robots)).await?,
        })
    }

    /// Writes seconds, overwriting existing ones.
    ///
    /// # Errors
    /// The database's failure.
    pub(crate) async fn write(
        &mut self,
        session: &mut Session,
        keys: &mut Keys,
        rows: &[HistoryRow],
    ) -> Result<Written, StoreError> {
        let mut written = Written::default();
        // A statement may write each second once: the latest counts.
        let mut seconds = BTreeMap::new();
        for row in rows {
            let received = WallTime(row.received_s.saturating_mul(NS_PER_S));
            let key = key_of(session, keys, &row.robot, received).await?;
            written.minutes.insert((key, start(row.t_s, MINUTE_S)));
            let day = row.received_s.div_euclid(DAY_S);
            // The next one as well: it is there before its first second.
            written.days.extend([day, day + 1]);
            seconds.insert((key, row.t_s), row);
        }
        for &day in written.days.difference(&self.days) {
            add_day(session, day).await?;
        }
        if !seconds.is_empty() {
            insert(session, &seconds)
                .await
                .map_err(StoreError::database("write robots' history"))?;
        }
        Ok(written)
    }

    /// Adds the writes of a committed transaction.
    pub(crate) fn take(&mut self, written: Written) {
        self.days.extend(written.days);
        // Yesterday's are of no use any more.
        while self.days.len() > limits::POSTGRES_DAYS_KNOWN_MAX {
            self.days.pop_first();
        }
        self.minutes.extend(written.minutes);
    }

    /// Returns the minutes to be rolled up next, if it is time or `everything` is requested; in
    /// parts that are committed one by one.
    pub(crate) fn next_part(&self, everything: bool) -> Option<Vec<(i64, i64)>> {
        let is_time = self.rolled_up_at.elapsed() >= limits::POSTGRES_ROLL_UP_EVERY
            || self.minutes.len() > limits::POSTGRES_ROLL_UP_WAITING_MAX;
        if self.minutes.is_empty() || !(is_time || everything) {
            return None;
        }
        let part = self.minutes.iter().take(limits::POSTGRES_ROLL_UP_MAX);
        Some(part.copied().collect())
    }

    /// True if seconds before `before_s`, which are to be deleted, are not rolled up yet: while
    /// somebody replays old ones.
    pub(crate) fn reaches(&self, before_s: i64) -> bool {
        let mut minutes = self.minutes.iter();
        minutes.any(|&(_, minute_s)| minute_s < before_s)
    }

    /// Removes a part that was rolled up and committed.
    pub(crate) fn rolled_up(&mut self, part: &[(i64, i64)]) {
        for minute in part {
            self.minutes.remove(minute);
        }
        if self.minutes.is_empty() {
            self.rolled_up_at = Instant::now();
        }
    }
}

/// Seconds that one transaction wrote, or found.
#[derive(Debug, Default)]
pub(crate) struct Written {
    days: BTreeSet<i64>,
    minutes: BTreeSet<(i64, i64)>,
}

/// Returns the minutes with seconds that were not rolled up; `robots` are the values of `asked`.
async fn not_rolled_up(
    session: &mut Session,
    asked: &str,
    robots: Option<&[i64]>,
) -> Result<BTreeSet<(i64, i64)>, StoreError> {
    let mut query = sqlx::query_as(sqlx::AssertSqlSafe(asked.to_owned()));
    if let Some(robots) = robots {
        query = query.bind(robots);
    }
    let rows = session.fetch(query).await;
    let rows = rows.map_err(StoreError::database("look for history to roll up"))?;
    Ok(rows.into_iter().collect())
}

/// Returns the first second of the stretch of this length that contains `t_s`.
const fn start(t_s: i64, length_s: i64) -> i64 {
    t_s - t_s.rem_euclid(length_s)
}

/// Makes a day's partition, unless it exists.
///
/// # Errors
/// The database's failure.
pub(crate) async fn add_day(session: &mut Session, day: i64) -> Result<(), StoreError> {
    let statement = Statement {
        sql: "SELECT 1 FROM history_add_day($1)".into(),
        values: vec![day.into()],
    };
    let added = session.rows(statement).await;
    added
        .map(drop)
        .map_err(StoreError::database("add a day to the history"))
}

/// Makes minutes again from their seconds, and their hours from the minutes.
///
/// # Errors
/// The database's failure.
pub(crate) async fn roll_up(
    session: &mut Session,
    minutes: &[(i64, i64)],
) -> Result<(), StoreError> {
    let hours: BTreeSet<(i64, i64)> = minutes
        .iter()
        .map(|&(key, minute_s)| (key, start(minute_s, HOUR_S)))
        .collect();
    let hours: Vec<_> = hours.into_iter().collect();
    for (sql, stretches) in [(&*MINUTES, minutes), (&*HOURS, hours.as_slice())] {
        let (keys, starts): (Vec<i64>, Vec<i64>) = stretches.iter().copied().unzip();
        let query = sqlx::query(sqlx::AssertSqlSafe(sql.as_str()));
        let rolled_up = session.execute_query(query.bind(keys).bind(starts)).await;
        rolled_up.map_err(StoreError::database("roll up robots' history"))?;
    }
    Ok(())
}

/// Writes seconds, which are usually new: `COPY` logs half as much as an `INSERT` that looks for
/// each row's key. Existing ones are deleted first.
async fn insert(
    session: &mut Session,
    seconds: &BTreeMap<(i64, i64), &HistoryRow>,
) -> Result<(), StatementError> {
    let mut days = days_of(seconds);
    session.run("SAVEPOINT new_seconds").await?;
    let within = limits::POSTGRES_STATEMENT_TIMEOUT;
    match session.copy_in(&COPY, copied(seconds), within).await {
        Err(_) if session.fate() == Fate::Conflict => {
            let undo = "ROLLBACK TO SAVEPOINT new_seconds";
            session.return_to(undo).await?;
            for (&day, written) in &mut days {
                let of_day = seconds
                    .keys()
                    .filter(|(_, t_s)| t_s.div_euclid(DAY_S) == day);
                written.more -= delete(session, of_day.copied().unzip()).await?;
            }
            session.copy_in(&COPY, copied(seconds), within).await?;
        }
        ended => ended?,
    }
    note_days(session, days).await
}

/// Writes to a day.
#[derive(Debug, Default)]
struct DayWritten {
    /// Time at which its newest row was received, s.
    received_s: i64,
    /// Growth of its number of rows.
    more: i64,
}

/// Returns the days of seconds that are all new.
fn days_of(seconds: &BTreeMap<(i64, i64), &HistoryRow>) -> BTreeMap<i64, DayWritten> {
    let mut days: BTreeMap<i64, DayWritten> = BTreeMap::new();
    for (&(_, t_s), row) in seconds {
        let day = days.entry(t_s.div_euclid(DAY_S)).or_default();
        day.received_s = day.received_s.max(row.received_s);
        day.more += 1;
    }
    days
}

/// Deletes seconds by their robots and times; returns the number of deleted rows.
async fn delete(
    session: &mut Session,
    (keys, t_s): (Vec<i64>, Vec<i64>),
) -> Result<i64, StatementError> {
    let query = sqlx::query(
        "DELETE FROM history_second AS s USING unnest($1::int8[], $2::int8[]) AS k (robot, t)
         WHERE s.robot = k.robot AND s.t = k.t",
    );
    let deleted = session.execute_query(query.bind(keys).bind(t_s)).await?;
    Ok(deleted.cast_signed())
}

/// Records the writes to each day, by which it is dropped later.
async fn note_days(
    session: &mut Session,
    days: BTreeMap<i64, DayWritten>,
) -> Result<(), StatementError> {
    for (day, written) in days {
        let noted = session.execute(Statement {
            sql: "UPDATE history_day SET received = greatest(received, $2),
                      row_count = row_count + $3 WHERE day = $1"
                .into(),
            values: vec![day.into(), written.received_s.into(), written.more.into()],
        });
        noted.await?;
    }
    Ok(())
}

/// Formats seconds in the text format of `COPY`, in the order of [`columns`].
fn copied(seconds: &BTreeMap<(i64, i64), &HistoryRow>) -> Vec<u8> {
    fn cell(value: Option<f64>) -> String {
        value.map_or_else(|| "\\N".to_owned(), |value| value.to_string())
    }
    let lines = seconds.iter().map(|(&(key, t_s), row)| {
        let whole = [key, t_s, row.received_s, row.status.number()];
        let mut cells: Vec<String> = whole.iter().map(ToString::to_string).collect();
        cells.push(cell(row.nis));
        for cells_of_parameter in &row.cells {
            cells.push(cell(cells_of_parameter.map(|(value, _)| value)));
            cells.push(cell(cells_of_parameter.map(|(_, sigma)| sigma)));
        }
        cells.join("\t") + "\n"
    });
    lines.collect::<String>().into_bytes()
}

/// Returns the columns of a second other than its key.
fn columns() -> Vec<String> {
    let parameters = Parameter::ALL.iter().flat_map(|parameter| {
        let p = parameter.name();
        [p.to_owned(), format!("{p}_sigma")]
    });
    ["received", "status", "nis"]
        .map(str::to_owned)
        .into_iter()
        .chain(parameters)
        .collect()
}

static COPY: LazyLock<String> = LazyLock::new(|| {
    let columns = columns().join(", ");
    format!("COPY history_second (robot, t, {columns}) FROM STDIN")
});

/// Writes the assignment of these columns from the new row.
fn overwritten(columns: &[String]) -> String {
    let set: Vec<String> = columns
        .iter()
        .map(|column| format!("{column} = excluded.{column}"))
        .collect();
    set.join(", ")
}

/// Query for seconds after the last minute that was rolled up, and those of that minute.
const NOT_ROLLED_UP: &str = "\
SELECT DISTINCT s.robot, s.t - ((s.t % 60) + 60) % 60
FROM robot AS r JOIN history_second AS s ON s.robot = r.key AND s.t >= coalesce(
    (SELECT max(m.t) FROM history_minute AS m WHERE m.robot = r.key), -9223372036854775808)";

/// Statement that makes minutes again from their seconds: keys and starts, as arrays.
static MINUTES: LazyLock<String> = LazyLock::new(|| {
    let mut values = Vec::new();
    for parameter in Parameter::ALL {
        let p = parameter.name();
        let value = in_turn(parameter, &format!("s.{p}"), &format!("s.{p}"));
        values.push(format!(
            "avg({value}), min({value}), max({value}), avg(s.{p}_sigma)"
        ));
    }
    roll_up_statement(
        "history_minute",
        &format!(
            "max(s.received), count(*), (array_agg(s.status ORDER BY s.t DESC))[1], avg(s.nis), \
             max(s.nis), {}",
            values.join(", ")
        ),
        "history_second",
        ("lidar_yaw", MINUTE_S),
    )
});

/// Statement that makes hours again from their minutes: keys and starts, as arrays. Means are
/// weighted by the minutes' counts.
static HOURS: LazyLock<String> = LazyLock::new(|| {
    let weighted = |mean: &str, column: &str| {
        format!("sum({mean} * s.count) / sum(s.count) FILTER (WHERE s.{column} IS NOT NULL)")
    };
    let mut values = Vec::new();
    for parameter in Parameter::ALL {
        let p = parameter.name();
        let centre = format!("s.{p}_mean");
        let part = |which: &str| in_turn(parameter, &format!("s.{p}_{which}"), &centre);
        values.extend([
            weighted(&part("mean"), &format!("{p}_mean")),
            format!("min({})", part("min")),
            format!("max({})", part("max")),
            weighted(&format!("s.{p}_sigma"), &format!("{p}_sigma")),
        ]);
    }
    roll_up_statement(
        "history_hour",
        &format!(
            "max(s.received), sum(s.count)::int8, (array_agg(s.status ORDER BY s.t DESC))[1], \
             {}, max(s.nis_max), {}",
            weighted("s.nis_mean", "nis_mean"),
            values.join(", ")
        ),
        "history_minute",
        ("lidar_yaw_mean", HOUR_S),
    )
});

/// Returns an expression for a heading within half a turn of the stretch's first one: a LiDAR that
/// looks backwards would otherwise have a mean of zero. Other parameters are unchanged.
fn in_turn(parameter: Parameter, value: &str, centre: &str) -> String {
    match parameter {
        Parameter::LidarYaw => format!(
            "({value} - {turn} * round(({centre} - first.yaw) / {turn}))",
            turn = std::f64::consts::TAU
        ),
        _ => value.to_owned(),
    }
}

/// Makes the statement that overwrites rows of `table` with `values` over the rows of `source`.
fn roll_up_statement(
    table: &str,
    values: &str,
    source: &str,
    (yaw, length_s): (&str, i64),
) -> String {
    let mut columns: Vec<String> = ["received", "count", "status", "nis_mean", "nis_max"]
        .map(str::to_owned)
        .to_vec();
    for parameter in Parameter::ALL {
        let p = parameter.name();
        let parts = ["mean", "min", "max", "sigma"];
        columns.extend(parts.map(|part| format!("{p}_{part}")));
    }
    let set = overwritten(&columns);
    let columns = columns.join(", ");
    format!(
        "INSERT INTO {table} (robot, t, {columns})
         SELECT d.robot, d.t, {values}
         FROM unnest($1::int8[], $2::int8[]) AS d (robot, t)
         LEFT JOIN LATERAL (
             SELECT {yaw} AS yaw FROM {source} AS f
             WHERE f.robot = d.robot AND f.t >= d.t AND f.t < d.t + {length_s}
                 AND f.{yaw} IS NOT NULL
             ORDER BY f.t LIMIT 1
         ) AS first ON true
         JOIN {source} AS s ON s.robot = d.robot AND s.t >= d.t AND s.t < d.t + {length_s}
         GROUP BY d.robot, d.t
         ON CONFLICT (robot, t) DO UPDATE SET {set}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A moment in 2026, s.
    const NOW_S: i64 = 1_767_225_600;

    fn with_minutes(minutes: impl IntoIterator<Item = (i64, i64)>) -> History {
        History {
            days: BTreeSet::new(),
            minutes: minutes.into_iter().collect(),
            rolled_up_at: Instant::now(),
        }
    }

    /// Checks that the search for old rows, once a second, does not itself start a roll-up.
    #[test]
    fn what_was_written_just_now_waits_for_its_time() {
        let mut history = with_minutes((0..1_000).map(|robot| (robot, NOW_S)));
        for kept in [limits::HISTORY_SECONDS_KEPT, limits::HISTORY_MINUTES_KEPT] {
            let kept_s = i64::try_from(kept.as_secs()).unwrap();
            assert!(!history.reaches(NOW_S - kept_s));
        }
        assert_eq!(history.next_part(false), None);
        history.rolled_up_at = Instant::now()
            .checked_sub(limits::POSTGRES_ROLL_UP_EVERY)
            .unwrap();
        let mut parts = 0;
        while let Some(part) = history.next_part(false) {
            assert!(part.len() <= limits::POSTGRES_ROLL_UP_MAX);
            history.rolled_up(&part);
            parts += 1;
        }
        assert_eq!(parts, 2);
    }

    /// Checks the limit on waiting minutes while somebody replays a year at once.
    #[test]
    fn no_more_minutes_wait_than_may() {
        let waiting = limits::POSTGRES_ROLL_UP_WAITING_MAX as i64;
        let minute = |number| (1, NOW_S + 60 * number);
        let history = with_minutes((0..waiting).map(minute));
        assert_eq!(history.next_part(false), None);
        let history = with_minutes((0..=waiting).map(minute));
        assert!(history.next_part(false).is_some());
    }

    #[test]
    fn seconds_that_are_to_go_are_rolled_up_before() {
        let history = with_minutes([(1, NOW_S), (2, NOW_S - 600)]);
        assert!(history.reaches(NOW_S - 300));
        assert_eq!(history.next_part(true).map(|part| part.len()), Some(2));
    }
}
