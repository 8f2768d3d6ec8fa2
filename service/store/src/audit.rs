//! Rows of the audit, each tied to all rows before it.

use fleetcal_domain::access::Actor;
use fleetcal_domain::audit::Action;
use fleetcal_model::{AuditId, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::signing::sha256_hex;
use serde::Serialize;
use serde_json::Value;
use thiserror::Error;

/// Row of the audit, written in the transaction of the change itself.
#[derive(Debug, Clone, PartialEq)]
pub struct AuditEntry {
    /// Time of the action, wall time.
    pub at_ns: WallTime,
    /// Actor of the action.
    pub actor: Actor,
    /// Action, which determines the kind of the record.
    pub action: Action,
    /// Number or name of the record.
    pub subject_id: String,
    /// Robot of the record.
    pub robot: Option<RobotId>,
    /// Record before; `None` for a new one.
    pub before: Option<Value>,
    /// Record after; `None` for a removed one.
    pub after: Option<Value>,
    /// Reason, in the actor's words.
    pub reason: Option<String>,
}

impl AuditEntry {
    /// Returns the row with its number, not linked yet.
    pub fn row(&self, id: AuditId) -> AuditRow {
        let request = self.actor.request.as_ref();
        AuditRow {
            id,
            at_ns: self.at_ns,
            actor: self.actor.name.clone(),
            authentication: self.actor.authentication.as_str().to_owned(),
            role: self.actor.role.map(|role| role.as_str().to_owned()),
            request: request.and_then(|request| request.id.clone()),
            address: request.and_then(|request| request.address.clone()),
            action: self.action.as_str().to_owned(),
            subject: self.action.subject().to_owned(),
            subject_id: self.subject_id.clone(),
            robot: self.robot.as_ref().map(|robot| robot.as_str().to_owned()),
            before: self.before.clone(),
            after: self.after.clone(),
            reason: self.reason.clone(),
            link: None,
        }
    }
}

/// Row of the audit.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct AuditRow {
    /// Number of the row.
    pub id: AuditId,
    /// Time of the action, ns since 1970, wall time.
    pub at_ns: WallTime,
    /// Name of the actor.
    pub actor: String,
    /// Proof of the actor's identity.
    pub authentication: String,
    /// Role of the actor.
    pub role: Option<String>,
    /// Id of the HTTP request.
    pub request: Option<String>,
    /// Client address of the HTTP request.
    pub address: Option<String>,
    /// Action on the record.
    pub action: String,
    /// Kind of the record.
    pub subject: String,
    /// Number or name of the record.
    pub subject_id: String,
    /// Robot of the record.
    pub robot: Option<String>,
    /// Record before the action.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<Object>))]
    pub before: Option<serde_json::Value>,
    /// Record after the action.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<Object>))]
    pub after: Option<serde_json::Value>,
    /// Reason for the action.
    pub reason: Option<String>,
    /// Link of the row: [`AuditRow::link_after`] the link of the row before it. `None` for rows of
    /// versions without links.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub link: Option<String>,
}

impl AuditRow {
    /// Returns the link of this row after a row with link `previous`: lower-case hexadecimal
    /// SHA-256 of that link (nothing if there is none), a line feed, and this row in JSON without
    /// its link, without spaces, its keys sorted.
    pub fn link_after(&self, previous: Option<&str>) -> String {
        let row = Self {
            link: None,
            ..self.clone()
        };
        let content = serde_json::json!(row);
        sha256_hex(format!("{}\n{content}", previous.unwrap_or_default()).as_bytes())
    }

    /// Checks that this row follows `before`, or is the first one if there is none before.
    ///
    /// # Errors
    /// Rows between them are missing, or either was changed.
    pub fn check_after(&self, before: Option<&Self>) -> Result<(), AuditBroken> {
        let expected = AuditId(before.map_or(1, |row| row.id.0 + 1));
        if self.id != expected {
            return Err(AuditBroken::Missing {
                expected,
                found: self.id,
            });
        }
        let previous = before.and_then(|row| row.link.as_deref());
        match &self.link {
            Some(link) if *link != self.link_after(previous) => Err(AuditBroken::Changed(self.id)),
            _ => Ok(()),
        }
    }
}

/// Finding in rows of the audit that were changed after they were written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum AuditBroken {
    /// Rows are missing, or stand in another order.
    #[error("row {expected} of the audit is missing: row {found} stands in its place")]
    Missing {
        /// Number of the missing row.
        expected: AuditId,
        /// Number of the row in its place.
        found: AuditId,
    },
    /// A row does not agree with its link.
    #[error("row {0} of the audit, or the one before it, was changed after it was written")]
    Changed(AuditId),
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(id: i64, reason: &str) -> AuditRow {
        AuditRow {
            id: AuditId(id),
            at_ns: WallTime(1_767_225_600_000_000_001),
            actor: "ana".to_owned(),
            authentication: "session".to_owned(),
            role: Some("approver".to_owned()),
            request: None,
            address: None,
            action: "proposal.approve".to_owned(),
            subject: "proposal".to_owned(),
            subject_id: "7".to_owned(),
            robot: Some("tugger_01".to_owned()),
            before: None,
            after: Some(serde_json::json!({"x_m": 0.1, "state": "approved"})),
            reason: Some(reason.to_owned()),
            link: None,
        }
    }

    fn linked() -> Vec<AuditRow> {
        let mut rows: Vec<AuditRow> = (1..=4).map(|id| row(id, "checked")).collect();
        let mut previous = None;
        for row in &mut rows {
            row.link = Some(row.link_after(previous.as_deref()));
            previous.clone_from(&row.link);
        }
        rows
    }

    fn checked(rows: &[AuditRow]) -> Result<(), AuditBroken> {
        let mut before = None;
        for row in rows {
            row.check_after(before)?;
            before = Some(row);
        }
        Ok(())
    }

    #[test]
    fn a_changed_removed_or_moved_row_is_found() {
        assert_eq!(checked(&linked()), Ok(()));
        let mut changed = linked();
        changed[1].reason = Some("not checked".to_owned());
        assert_eq!(checked(&changed), Err(AuditBroken::Changed(AuditId(2))));
        let mut changed_with_its_link = linked();
        changed_with_its_link[1].reason = Some("not checked".to_owned());
        let previous = changed_with_its_link[0].link.clone();
        let link = changed_with_its_link[1].link_after(previous.as_deref());
        changed_with_its_link[1].link = Some(link);
        let found = checked(&changed_with_its_link);
        assert_eq!(found, Err(AuditBroken::Changed(AuditId(3))));
        let mut removed = linked();
        removed.remove(2);
        let missing = AuditBroken::Missing {
            expected: AuditId(3),
            found: AuditId(4),
        };
        assert_eq!(checked(&removed), Err(missing));
    }

    #[test]
    fn rows_of_former_versions_have_no_link_and_later_ones_start_new_links() {
        let mut rows = linked();
        rows[0].link = None;
        assert_eq!(checked(&rows), Err(AuditBroken::Changed(AuditId(2))));
        let mut previous = None;
        for row in &mut rows[1..] {
            row.link = Some(row.link_after(previous.as_deref()));
            previous.clone_from(&row.link);
        }
        assert_eq!(checked(&rows), Ok(()));
    }

    /// Links that were written are checked by later versions: the text they are over never changes.
    #[test]
    fn the_text_of_a_link_is_the_one_of_every_version() {
        let link = row(1, "checked").link_after(None);
        assert_eq!(
            link,
            "11d8bdbae7865e2e470ee4a313b320016c28a56bd601962c82c041cdf71322ac"
        );
    }
}
