//! The statements whose columns are the parameters, written out of one list.

use std::sync::LazyLock;

use fleetcal_model::Parameter;
use fleetcal_store::backend::Tier;

/// Writes a row of `history_second`: `t, robot, received, status, nis`, then value and sigma of
/// each parameter. Does nothing when the second is there already.
pub(super) static INSERT_SECOND: LazyLock<String> = LazyLock::new(|| {
    format!(
        "INSERT INTO {} ON CONFLICT (t, robot) DO NOTHING",
        second_row()
    )
});

/// The same, overwriting the second.
pub(super) static REPLACE_SECOND: LazyLock<String> =
    LazyLock::new(|| format!("REPLACE INTO {}", second_row()));

/// Merges one second into its minute: `t, robot, received, status, nis`, then value and sigma of
/// each parameter, as for [`INSERT_SECOND`] but with the minute's start.
pub(super) static MERGE_MINUTE: LazyLock<String> = LazyLock::new(|| merge_second(Tier::Minute));

/// Merges one second into its hour.
pub(super) static MERGE_HOUR: LazyLock<String> = LazyLock::new(|| merge_second(Tier::Hour));

/// Makes a minute again from its seconds: `robot, start, end`.
pub(super) static REMAKE_MINUTE: LazyLock<String> = LazyLock::new(|| remake(Tier::Minute));

/// Makes an hour again from its minutes: `robot, start, end`.
pub(super) static REMAKE_HOUR: LazyLock<String> = LazyLock::new(|| remake(Tier::Hour));

/// The table of a tier.
pub(super) const fn table(tier: Tier) -> &'static str {
    match tier {
        Tier::Second => "history_second",
        Tier::Minute => "history_minute",
        Tier::Hour => "history_hour",
    }
}

/// Reads a robot's rows of a tier: `from, to, step, robot`. Gives `t, count, status, nis`, then
/// mean, min, max and sigma of each parameter.
///
/// The key begins with the time, so each row is looked up by itself: a range would run over the
/// rows of the whole fleet.
pub(super) fn select(tier: Tier, parameters: &[Parameter]) -> String {
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
    format!(
        "WITH RECURSIVE tick (t) AS (
             SELECT ?1 WHERE ?1 < ?2
             UNION ALL SELECT t + ?3 FROM tick WHERE t + ?3 < ?2
         )
         SELECT {columns} FROM tick
         CROSS JOIN {table} AS h ON h.t = tick.t AND h.robot = ?4
         ORDER BY tick.t",
        table = table(tier)
    )
}

fn second_row() -> String {
    let mut columns = String::new();
    let mut values = String::new();
    for (index, parameter) in Parameter::ALL.iter().enumerate() {
        let p = parameter.name();
        append(&mut columns, format_args!(", {p}, {p}_sigma"));
        append(
            &mut values,
            format_args!(", ?{}, ?{}", 6 + 2 * index, 7 + 2 * index),
        );
    }
    format!(
        "history_second (t, robot, received, status, nis{columns}) \
         VALUES (?1, ?2, ?3, ?4, ?5{values})"
    )
}

fn merge_second(tier: Tier) -> String {
    let mut values = String::new();
    for index in 0..Parameter::ALL.len() {
        let (value, sigma) = (6 + 2 * index, 7 + 2 * index);
        append(
            &mut values,
            format_args!(", ?{value}, ?{value}, ?{value}, ?{sigma}"),
        );
    }
    format!(
        "INSERT INTO {} VALUES (?1, ?2, ?3, 1, ?4, ?5, ?5{values}) {}",
        roll_up_row(tier),
        on_conflict_merge()
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
         FROM {source} WHERE t >= ?2 AND t < ?3 AND robot = ?1 ORDER BY t {merge}",
        row = roll_up_row(tier),
        length = tier.seconds(),
        source = table(source),
        merge = on_conflict_merge()
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

/// Merges the new row into the one that is there. Means are weighted by the rows' counts; a
/// parameter that one of the two lacks is taken from the other.
fn on_conflict_merge() -> String {
    let mut set = "ON CONFLICT (t, robot) DO UPDATE SET \
                   received = max(received, excluded.received), \
                   count = count + excluded.count, \
                   status = excluded.status"
        .to_owned();
    merge_mean(&mut set, "nis_mean", "excluded.nis_mean");
    merge_extreme(&mut set, "max", "nis_max", "excluded.nis_max");
    for parameter in Parameter::ALL {
        let p = parameter.name();
        let new = |which: &str| match parameter {
            // The same heading, brought within half a turn of the mean that is there: a LiDAR
            // that looks backwards would otherwise have a mean of zero.
            Parameter::LidarYaw => format!(
                "(excluded.{p}_{which} - {turn} * \
                 coalesce(round((excluded.{p}_mean - {p}_mean) / {turn}), 0))",
                turn = std::f64::consts::TAU
            ),
            _ => format!("excluded.{p}_{which}"),
        };
        merge_mean(&mut set, &format!("{p}_mean"), &new("mean"));
        merge_extreme(&mut set, "min", &format!("{p}_min"), &new("min"));
        merge_extreme(&mut set, "max", &format!("{p}_max"), &new("max"));
        merge_mean(
            &mut set,
            &format!("{p}_sigma"),
            &format!("excluded.{p}_sigma"),
        );
    }
    set
}

fn merge_mean(set: &mut String, column: &str, new: &str) {
    append(
        set,
        format_args!(
            ", {column} = coalesce({column} + ({new} - {column}) * excluded.count \
             / (count + excluded.count), {new}, {column})"
        ),
    );
}

fn merge_extreme(set: &mut String, which: &str, column: &str, new: &str) {
    append(
        set,
        format_args!(", {column} = {which}(coalesce({column}, {new}), coalesce({new}, {column}))"),
    );
}

fn append(text: &mut String, part: std::fmt::Arguments<'_>) {
    text.push_str(&part.to_string());
}
