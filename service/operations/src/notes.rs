//! Stored notes on their way to the estimators of their robots.

use fleetcal_domain::limits;
use fleetcal_fleet::{FleetHandle, Noted};
use fleetcal_model::{NoteKind, RobotId, RobotTime};
use fleetcal_proto::event::RobotEvent;
use fleetcal_store::{AuditRow, Store, StoreError};
use serde::Deserialize;

/// Note in the audit's form.
#[derive(Debug, Deserialize)]
struct Document {
    kind: NoteKind,
    stamp_ns: RobotTime,
    #[serde(default)]
    note: Option<String>,
}

/// Note of a row of the audit; `None` for a row of another kind.
pub(crate) fn event_of(row: &AuditRow) -> Option<RobotEvent> {
    let document = row.after.clone()?;
    let Document {
        kind,
        stamp_ns,
        note,
    } = serde_json::from_value(document).ok()?;
    Some(RobotEvent {
        kind,
        stamp_ns,
        note: note.unwrap_or_default(),
    })
}

/// Passes stored notes that a robot's estimator has not processed to it, in their order, if the
/// robot is estimated here. Notes without room in its mailbox are passed at the next call.
///
/// # Errors
/// The database's failure.
pub async fn bring(store: &Store, fleet: &FleetHandle, robot: &RobotId) -> Result<(), StoreError> {
    // A task that has not begun yet asks for them when it does.
    let Some(mut after) = fleet.notes_taken(robot) else {
        return Ok(());
    };
    loop {
        let rows = store
            .notes_after(robot, after, limits::NOTES_BROUGHT_MAX)
            .await?;
        let Some(last) = rows.last() else {
            return Ok(());
        };
        after = last.id;
        for row in &rows {
            let Some(event) = event_of(row) else { continue };
            let number = row.id;
            if let Err(refused) = fleet.note(robot, Noted { number, event }) {
                tracing::warn!(robot.id = %robot, %refused, "a note waits");
                return Ok(());
            }
        }
    }
}
