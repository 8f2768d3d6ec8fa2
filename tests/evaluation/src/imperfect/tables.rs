//! The tables of a study of imperfect robots.

use super::campaign::Campaign;
use super::cell::{Cell, Flaw, InjectedChange, Road, Scenario, Sensor, Speed};
use super::run::CLAIMS_AT_S;
use super::summary::Summary;
use crate::error::EvaluationError;
use crate::report::Table;

/// Pooled outcomes of one imperfection at one strength.
#[derive(Debug, Clone)]
pub struct Row {
    /// Imperfection of the robots.
    pub flaw: Flaw,
    /// Their outcomes.
    pub summary: Summary,
}

/// Drives the unchanged robots of each flaw, over some routes.
///
/// # Errors
/// The error of a run.
pub fn unchanged(
    campaign: &mut Campaign,
    flaws: &[Flaw],
    seeds: &[u64],
    roads: &[Road],
) -> Result<Vec<Row>, EvaluationError> {
    pooled(campaign, flaws, seeds, roads, &[Scenario::Unchanged])
}

/// Drives the robots of each flaw with the change `injected`, over some routes and both speeds.
///
/// # Errors
/// The error of a run.
pub fn changed(
    campaign: &mut Campaign,
    flaws: &[Flaw],
    seeds: &[u64],
    roads: &[Road],
    injected: InjectedChange,
) -> Result<Vec<Row>, EvaluationError> {
    let scenarios = Speed::ALL.map(|speed| Scenario::Changed(injected, speed));
    pooled(campaign, flaws, seeds, roads, &scenarios)
}

fn pooled(
    campaign: &mut Campaign,
    flaws: &[Flaw],
    seeds: &[u64],
    roads: &[Road],
    scenarios: &[Scenario],
) -> Result<Vec<Row>, EvaluationError> {
    let mut rows = Vec::new();
    for &flaw in flaws {
        let mut summary = Summary::default();
        for &road in roads {
            for &scenario in scenarios {
                let cell = Cell {
                    flaw,
                    road,
                    sensor: sensor_of(flaw),
                    scenario,
                };
                summary.add(cell, &campaign.outcomes(cell, seeds)?);
            }
        }
        rows.push(Row { flaw, summary });
    }
    Ok(rows)
}

/// Returns poses if they show the imperfection, because they cost a tenth of scans.
pub fn sensor_of(flaw: Flaw) -> Sensor {
    if flaw.needs_scans() || flaw == Flaw::AllTypical {
        Sensor::Scans
    } else {
        Sensor::Poses
    }
}

/// Makes the table of false claims and false changes of unchanged robots.
pub fn claims_table(rows: &[Row]) -> Table {
    let mut table = Table::new(&[
        "imperfection",
        "strength",
        "from",
        "60 s",
        "120 s",
        "180 s",
        "600 s",
        "one of the four",
        "worst claim",
        "false changes",
    ]);
    for Row { flaw, summary } in rows {
        let at = CLAIMS_AT_S.map(|at_s| {
            let claims = summary.false_claims_at(at_s);
            if claims.of == 0 {
                "–".to_owned()
            } else {
                format!("{}/{}", claims.count, claims.of)
            }
        });
        let head = [flaw.name(), flaw.strength(), sensor_of(*flaw).name()];
        let tail = [
            summary.false_claims().to_string(),
            format!("{:.1} σ", summary.worst_claim()),
            summary.false_changes().to_string(),
        ];
        table.row(head.map(str::to_owned).into_iter().chain(at).chain(tail));
    }
    table
}

/// Makes the table of convergence, errors and consistency of unchanged robots.
pub fn errors_table(rows: &[Row]) -> Table {
    let mut table = Table::new(&[
        "imperfection",
        "strength",
        "converged after 180 s",
        "and within 3 mm, 5 mm, 0.03°, 0.02°",
        "median time to it",
        "x, mm",
        "y, mm",
        "yaw, °",
        "steering, °",
        "NEES 60, 180, 600 s",
    ]);
    for Row { flaw, summary } in rows {
        let [x_m, y_m, yaw_rad, steering_rad] = summary.rms_errors();
        let share = |of: crate::statistics::Proportion| format!("{}/{}", of.count, of.of);
        table.row([
            flaw.name().to_owned(),
            flaw.strength().to_owned(),
            share(summary.converged()),
            share(summary.converged_within_bounds()),
            seconds(summary.converged_after_s()),
            format!("{:.2}", 1e3 * x_m),
            format!("{:.2}", 1e3 * y_m),
            format!("{:.4}", yaw_rad.to_degrees()),
            format!("{:.4}", steering_rad.to_degrees()),
            [60.0, 180.0, 600.0]
                .map(|at_s| format!("{:.2}", summary.nees_at(at_s)))
                .join(", "),
        ]);
    }
    table
}

/// Makes the table of the distances that changed robots drive until the alarm.
pub fn changes_table(rows: &[Row]) -> Table {
    let mut table = Table::new(&[
        "imperfection",
        "strength",
        "median, m",
        "95 %, m",
        "not within 40 m",
        "wrong cause",
        "false claim 20 m later",
        "flagged before",
    ]);
    for Row { flaw, summary } in rows {
        table.row([
            flaw.name().to_owned(),
            flaw.strength().to_owned(),
            metres(summary.flagged_after_m(0.5), "missed"),
            metres(summary.flagged_after_m(0.95), "missed"),
            summary.missed().to_string(),
            summary.wrong_cause().to_string(),
            summary.false_claims_after_change().to_string(),
            summary.false_changes().to_string(),
        ]);
    }
    table
}

/// Makes the table of the distances that robots without an imperfection drive on each route until
/// the alarm, and until they have turned.
///
/// # Errors
/// The error of a run.
pub fn turns_table(
    campaign: &mut Campaign,
    seeds: &[u64],
    injected: InjectedChange,
) -> Result<Table, EvaluationError> {
    let mut table = Table::new(&[
        "route",
        "flagged: median, m",
        "95 %, m",
        "turned by 45°: median, m",
        "95 %, m",
    ]);
    for road in Road::ALL {
        for Row { summary, .. } in changed(campaign, &[Flaw::Clean], seeds, &[road], injected)? {
            table.row([
                road.name().to_owned(),
                metres(summary.flagged_after_m(0.5), "missed"),
                metres(summary.flagged_after_m(0.95), "missed"),
                metres(summary.turned_after_m(0.5), "never"),
                metres(summary.turned_after_m(0.95), "never"),
            ]);
        }
    }
    Ok(table)
}

fn seconds(value_s: f64) -> String {
    if value_s.is_finite() {
        format!("{value_s:.0} s")
    } else {
        "never".to_owned()
    }
}

fn metres(value_m: f64, or_else: &str) -> String {
    if value_m.is_finite() {
        format!("{value_m:.1}")
    } else {
        or_else.to_owned()
    }
}
