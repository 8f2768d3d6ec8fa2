//! Head of a service's audit: its last row at one moment, signed.
//!
//! Kept outside the service, it shows later whether rows up to it were changed or removed. It
//! travels as an [`Envelope`](crate::calibration::Envelope), as a certificate does.

use fleetcal_model::AuditId;
use serde::{Deserialize, Serialize};

/// Schema of a head.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum AuditHeadSchema {
    /// The first version.
    #[default]
    #[serde(rename = "fleetcal.audit_head/1")]
    V1,
}

/// Last row of the audit.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct AuditHeadDocument {
    /// Schema of the document.
    pub schema: AuditHeadSchema,
    /// Number of the row.
    pub row: AuditId,
    /// Its link, lower-case hexadecimal SHA-256, which ties it to all rows before it.
    pub link: String,
    /// Time of the signature, RFC 3339 in UTC.
    pub signed: String,
}
