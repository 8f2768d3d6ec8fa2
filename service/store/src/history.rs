//! History of a robot at the requested resolution, with its extremes.

use std::f64::consts::TAU;

use fleetcal_domain::limits;
use fleetcal_model::Parameter;
use fleetcal_proto::RobotId;

use super::backend::{Cell, Reader, Stretch, Tier};
use super::error::StoreError;

/// Query of a robot's history.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HistoryQuery {
    /// Robot of the history.
    pub robot: RobotId,
    /// Requested parameters.
    pub parameters: Vec<Parameter>,
    /// First second, message time.
    pub from_s: i64,
    /// Second after the last one, message time.
    pub to_s: i64,
    /// Largest number of stretches.
    pub points_max: u32,
}

/// Result of a query.
#[derive(Debug, Clone, PartialEq)]
pub struct History {
    /// Length of each stretch, s.
    pub bucket_s: i64,
    /// The stretches that have data, oldest first. One never spans more than `bucket_s`.
    pub stretches: Vec<Stretch>,
}

/// Reads a robot's history from the finest tier that a span of this length can be read from, and
/// the part that this tier no longer has from the coarser ones.
pub(super) async fn read(reader: &dyn Reader, query: &HistoryQuery) -> Result<History, StoreError> {
    let mut stretches = Vec::new();
    let mut coarsest = None;
    let mut end_s = query.to_s;
    let mut tier = Some(finest_tier(query.to_s - query.from_s));
    while let Some(reading) = tier {
        if let Some((first_s, last_s)) = reader.extent(reading).await? {
            let from_s = query.from_s.max(first_s);
            let until_s = end_s.min(last_s + 1);
            let parameters = &query.parameters;
            let start_s = from_s - from_s.rem_euclid(reading.seconds());
            let mut rows = reader
                .stretches(&query.robot, reading, parameters, start_s, until_s)
                .await?;
            if let Some(first) = rows.first() {
                coarsest = Some(reading);
                end_s = first.t_s;
            }
            rows.append(&mut stretches);
            stretches = rows;
        }
        tier = reading.coarser();
        if let (Some(next), Some(_)) = (tier, coarsest) {
            // A coarser row must end where the finer ones begin.
            end_s = end_s - next.seconds() + 1;
        }
    }
    let bucket_s = bucket(query, coarsest.unwrap_or(Tier::Second));
    let headings: Vec<bool> = query
        .parameters
        .iter()
        .map(|&name| name == Parameter::LidarYaw)
        .collect();
    Ok(History {
        bucket_s,
        stretches: merge_buckets(&stretches, bucket_s, &headings),
    })
}

/// Finest tier from which a span can be read without too many rows.
fn finest_tier(span_s: i64) -> Tier {
    let readable = |tier: Tier| span_s / tier.seconds() <= limits::HISTORY_ROWS_MAX;
    [Tier::Second, Tier::Minute]
        .into_iter()
        .find(|&tier| readable(tier))
        .unwrap_or(Tier::Hour)
}

/// Length of a stretch, s: a whole number of rows, such that the span has at most `points_max`.
///
/// Buckets begin at multiples of their length since the Unix epoch, so that they are stable while a
/// chart advances; hence the span may touch one more bucket.
fn bucket(query: &HistoryQuery, tier: Tier) -> i64 {
    let length_s = tier.seconds();
    let span_s = (query.to_s - query.from_s).max(1);
    let rows = (span_s + length_s - 1) / length_s + i64::from(length_s > 1);
    let points = i64::from(query.points_max.max(2));
    if rows <= points {
        length_s
    } else {
        (rows + points - 2) / (points - 1) * length_s
    }
}

/// Merges the rows of each bucket.
fn merge_buckets(rows: &[Stretch], bucket_s: i64, headings: &[bool]) -> Vec<Stretch> {
    let mut merged: Vec<Stretch> = Vec::new();
    for row in rows {
        let start_s = row.t_s - row.t_s.rem_euclid(bucket_s);
        match merged.last_mut() {
            Some(last) if last.t_s == start_s => merge(last, row, headings),
            _ => merged.push(Stretch {
                t_s: start_s,
                ..row.clone()
            }),
        }
    }
    unwind(&mut merged, headings);
    merged
}

/// Merges a row into an earlier one: means are weighted by their seconds, extremes are kept.
fn merge(into: &mut Stretch, row: &Stretch, headings: &[bool]) {
    let weight = f64::from(row.count) / f64::from((into.count + row.count).max(1));
    into.count += row.count;
    into.status = row.status;
    into.nis = match (into.nis, row.nis) {
        (Some(old), Some(new)) => Some(old + (new - old) * weight),
        (old, new) => new.or(old),
    };
    for ((cell, new), &heading) in into.cells.iter_mut().zip(&row.cells).zip(headings) {
        *cell = match (*cell, *new) {
            (Some(old), Some(new)) => Some(merge_cell(old, new, weight, heading)),
            (old, new) => new.or(old),
        };
    }
}

fn merge_cell(old: Cell, new: Cell, weight: f64, heading: bool) -> Cell {
    let new = if heading { near(new, old.mean) } else { new };
    Cell {
        mean: old.mean + (new.mean - old.mean) * weight,
        min: old.min.min(new.min),
        max: old.max.max(new.max),
        sigma: old.sigma + (new.sigma - old.sigma) * weight,
    }
}

/// Unwraps headings by whole turns so that each lies within half a turn of the one before: the
/// heading of a LiDAR that looks backwards is drawn as one line.
fn unwind(stretches: &mut [Stretch], headings: &[bool]) {
    for (index, _) in headings.iter().enumerate().filter(|(_, heading)| **heading) {
        let mut before: Option<f64> = None;
        for cell in stretches
            .iter_mut()
            .filter_map(|stretch| stretch.cells.get_mut(index))
        {
            let Some(value) = cell else { continue };
            let turned = near(*value, before.unwrap_or(value.mean));
            before = Some(turned.mean);
            *value = turned;
        }
    }
}

/// Same heading within half a turn of `mean_rad`.
fn near(cell: Cell, mean_rad: f64) -> Cell {
    let turn = TAU * ((cell.mean - mean_rad) / TAU).round();
    Cell {
        mean: cell.mean - turn,
        min: cell.min - turn,
        max: cell.max - turn,
        ..cell
    }
}
