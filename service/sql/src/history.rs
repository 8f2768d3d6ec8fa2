//! The statements whose columns are the parameters, written out of one list.

use std::sync::LazyLock;

use fleetcal_model::Parameter;
use fleetcal_store::backend::Tier;

use super::dialect::Dialect;
use super::query::{Query, query};

/// Statements that write history.
pub(super) struct Statements {
    /// Writes a row of `history_second`: `t, robot, received, status, nis`, then value and sigma of
    /// each parameter. Does nothing if the second exists already.
    pub(super) insert_second: String,
    /// Writes the same row, overwriting the second.
    pub(super) replace_second: String,
    /// Merges one second into its minute: `t, robot, received, status, nis`, then value and sigma
    /// of each parameter, as for `insert_second` but with the minute's start.
    pub(super) merge_minute: String,
    /// Merges one second into its hour.
    pub(super) merge_hour: String,
    /// Merges seconds into their minute: `robot, start, end`.
    pub(super) remake_minute: String,
    /// Merges minutes into their hour: `robot, start, end`.
    pub(super) remake_hour: String,
}

/// Statements for single rows, as SQLite writes seconds. PostgreSQL's driver writes many at once.
pub(super) static STATEMENTS: LazyLock<Statements> = LazyLock::new(Statements::new);

impl Statements {
    fn new() -> Self {
        let row = second_row();
        Self {
            insert_second: format!("INSERT INTO {row} ON CONFLICT (t, robot) DO NOTHING"),
            replace_second: format!(
                "INSERT INTO {row} ON CONFLICT (t, robot) DO UPDATE SET {}",
                overwritten()
            ),
            merge_minute: merge_second(Tier::Minute),
            merge_hour: merge_second(Tier::Hour),
            remake_minute: remake(Tier::Minute),
            remake_hour: remake(Tier::Hour),
        }
    }
}

/// Returns the table of a tier.
pub(super) const fn table(tier: Tier) -> &'static str {
    match tier {
        Tier::Second => "history_second",
        Tier::Minute => "history_minute",
        Tier::Hour => "history_hour",
    }
}

/// Reads a robot's rows of a tier: `from, to, robot`. Returns `t, count, status, nis`, then mean,
/// min, max and sigma of each parameter.
///
/// SQLite's key begins with the time, so each row is looked up by itself: a range would run over
/// the rows of the whole fleet. That of PostgreSQL begins with the robot.
pub(super) fn select(dialect: Dialect, tier: Tier, parameters: &[Parameter]) -> Query {
    let mut columns = match tier {
        Tier::Second => "h.t, 1, h.status, h.nis".to_owned(),
        Tier::Minute | Tier::Hour => "h.t, h.count, h.status, h.nis_mean".to_owned(),
    };
    for parameter in parameters {
        let p = parameter.name();
        match tier {
            Tier::Second => {
                append(
                    &mut columns,
                    format_args!(", h.{p}, h.{p}, h.{p}, h.{p}_sigma"),
                );
            }
            Tier::Minute | Tier::Hour => {
                let roll_up = format_args!(", h.{p}_mean, h.{p}_min, h.{p}_max, h.{p}_sigma");
                append(&mut columns, roll_up);
            }
        }
    }
    let (table, step) = (table(tier), tier.seconds());
    query(match dialect {
        Dialect::Sqlite => format!(
            "WITH RECURSIVE tick (t) AS (
                 SELECT $1 WHERE $1 < $2
                 UNION ALL SELECT t + {step} FROM tick WHERE t + {step} < $2
             )
             SELECT {columns} FROM tick
             CROSS JOIN {table} AS h ON h.t = tick.t AND h.robot = $3
             ORDER BY tick.t"
        ),
        Dialect::Postgres => format!(
            "SELECT {columns} FROM {table} AS h
             WHERE h.robot = $3 AND h.t >= $1 AND h.t < $2 AND (h.t - $1) % {step} = 0
             ORDER BY h.t"
        ),
    })
}

/// Reads the first and the last second of a tier over all robots. Each comes from an end of the
/// key, which only a lone `min` or `max` is taken from: of the whole in SQLite, of each robot in
/// PostgreSQL.
pub(super) fn extent(dialect: Dialect, tier: Tier) -> String {
    let table = table(tier);
    match dialect {
        Dialect::Sqlite => {
            format!("SELECT (SELECT min(t) FROM {table}), (SELECT max(t) FROM {table})")
        }
        Dialect::Postgres => format!(
            "SELECT min((SELECT min(t) FROM {table} WHERE robot = r.key)), \
             max((SELECT max(t) FROM {table} WHERE robot = r.key)) FROM robot AS r"
        ),
    }
}

fn second_row() -> String {
    let mut columns = String::new();
    let mut values = String::new();
    for (index, parameter) in Parameter::ALL.iter().enumerate() {
        let p = parameter.name();
        append(&mut columns, format_args!(", {p}, {p}_sigma"));
        append(
            &mut values,
            format_args!(", ${}, ${}", 6 + 2 * index, 7 + 2 * index),
        );
    }
    format!(
        "history_second (t, robot, received, status, nis{columns}) \
         VALUES ($1, $2, $3, $4, $5{values})"
    )
}

fn merge_second(tier: Tier) -> String {
    let mut values = String::new();
    for index in 0..Parameter::ALL.len() {
        let (value, sigma) = (6 + 2 * index, 7 + 2 * index);
        append(
            &mut values,
            format_args!(", ${value}, ${value}, ${value}, ${sigma}"),
        );
    }
    format!(
        "INSERT INTO {} VALUES ($1, $2, $3, 1, $4, $5, $5{values}) {}",
        roll_up_row(tier),
        on_conflict_merge(tier)
    )
}

fn remake(tier: Tier) -> String {
    let (from, source) = match tier {
        Tier::Hour => ("count, status, nis_mean, nis_max", Tier::Minute),
        Tier::Second | Tier::Minute => ("1, status, nis, nis", Tier::Second),
    };
    let mut columns = String::new();
    for parameter in Parameter::ALL {
        let p = parameter.name();
        match source {
            Tier::Second => append(&mut columns, format_args!(", {p}, {p}, {p}, {p}_sigma")),
            Tier::Minute | Tier::Hour => {
                append(
                    &mut columns,
                    format_args!(", {p}_mean, {p}_min, {p}_max, {p}_sigma"),
                );
            }
        }
    }
    format!(
        "INSERT INTO {row} SELECT t - t % {length}, robot, received, {from}{columns} \
         FROM {source} WHERE t >= $2 AND t < $3 AND robot = $1 ORDER BY t {merge}",
        row = roll_up_row(tier),
        length = tier.seconds(),
        source = table(source),
        merge = on_conflict_merge(tier)
    )
}

fn roll_up_row(tier: Tier) -> String {
    let mut columns = String::new();
    for parameter in Parameter::ALL {
        let p = parameter.name();
        append(
            &mut columns,
            format_args!(", {p}_mean, {p}_min, {p}_max, {p}_sigma"),
        );
    }
    format!(
        "{} (t, robot, received, count, status, nis_mean, nis_max{columns})",
        table(tier)
    )
}

/// Writes the assignment of every column of a second, except its key, from the new row.
fn overwritten() -> String {
    let mut set =
        "received = excluded.received, status = excluded.status, nis = excluded.nis".to_owned();
    for parameter in Parameter::ALL {
        let p = parameter.name();
        append(
            &mut set,
            format_args!(", {p} = excluded.{p}, {p}_sigma = excluded.{p}_sigma"),
        );
    }
    set
}

/// Merges the new row into the one that is there. Means are weighted by the rows' counts; a
/// parameter that one of the two lacks is taken from the other.
fn on_conflict_merge(tier: Tier) -> String {
    let merge = Merge(table(tier));
    let table = table(tier);
    let mut set = format!(
        "ON CONFLICT (t, robot) DO UPDATE SET \
         received = max({table}.received, excluded.received), \
         count = {table}.count + excluded.count, \
         status = excluded.status"
    );
    merge.mean(&mut set, "nis_mean", "excluded.nis_mean");
    merge.extreme(&mut set, "max", "nis_max", "excluded.nis_max");
    for parameter in Parameter::ALL {
        let p = parameter.name();
        let new = |which: &str| match parameter {
            // The same heading, brought within half a turn of the mean that is there: a LiDAR
            // that looks backwards would otherwise have a mean of zero.
            Parameter::LidarYaw => format!(
                "(excluded.{p}_{which} - {turn} * \
                 coalesce(round((excluded.{p}_mean - {table}.{p}_mean) / {turn}), 0))",
                turn = std::f64::consts::TAU
            ),
            _ => format!("excluded.{p}_{which}"),
        };
        merge.mean(&mut set, &format!("{p}_mean"), &new("mean"));
        merge.extreme(&mut set, "min", &format!("{p}_min"), &new("min"));
        merge.extreme(&mut set, "max", &format!("{p}_max"), &new("max"));
        merge.mean(
            &mut set,
            &format!("{p}_sigma"),
            &format!("excluded.{p}_sigma"),
        );
    }
    set
}

/// Expressions that merge new rows into those of a table.
struct Merge(&'static str);

impl Merge {
    fn mean(&self, set: &mut String, column: &str, new: &str) {
        let table = self.0;
        append(
            set,
            format_args!(
                ", {column} = coalesce({table}.{column} + ({new} - {table}.{column}) \
                 * excluded.count / ({table}.count + excluded.count), {new}, {table}.{column})"
            ),
        );
    }

    fn extreme(&self, set: &mut String, which: &str, column: &str, new: &str) {
        let table = self.0;
        append(
            set,
            format_args!(
                ", {column} = {which}(coalesce({table}.{column}, {new}), \
                 coalesce({new}, {table}.{column}))"
            ),
        );
    }
}

fn append(text: &mut String, part: std::fmt::Arguments<'_>) {
    text.push_str(&part.to_string());
}
