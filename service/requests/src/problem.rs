//! Errors as RFC 9457 problem documents.

use axum::Json;
use axum::http::{HeaderValue, Method, StatusCode, header};
use axum::response::{IntoResponse, Response};
use fleetcal_domain::access::AccountRefused;
use fleetcal_domain::alert::AlertRefused;
use fleetcal_domain::approval::Refused;
use fleetcal_domain::webhook::WebhookRefused;
use fleetcal_fleet::FleetRefused;
use fleetcal_rollout::RolloutRefused;
use fleetcal_store::StoreError;
use serde::Serialize;

/// Wait before a client's next attempt, s.
const RETRY_AFTER_S: u32 = 2;

/// Reason for which a request was refused or failed, as an RFC 9457 problem.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, utoipa::ToSchema)]
#[schema(as = Problem)]
pub struct Problem {
    /// Always `about:blank`: problems are distinguished by `code`.
    #[serde(rename = "type")]
    #[schema(examples("about:blank"))]
    kind: &'static str,
    /// The status in words.
    #[schema(examples("Not Found"))]
    title: String,
    /// The HTTP status.
    #[schema(value_type = u16, examples(404))]
    status: u16,
    /// Code for programs.
    #[schema(examples("robot_unknown"))]
    code: &'static str,
    /// One sentence for people.
    #[schema(examples("no robot tugger_01 is known"))]
    detail: String,
    /// The parameter, field or header that was refused.
    #[serde(skip_serializing_if = "Option::is_none")]
    field: Option<String>,
    /// Seconds to wait before the next attempt; the header `Retry-After`.
    #[serde(skip)]
    retry_after_s: Option<u32>,
}

impl Problem {
    /// Makes a problem with this status and code.
    pub fn new(status: StatusCode, code: &'static str, detail: impl Into<String>) -> Self {
        Self {
            kind: "about:blank",
            title: status.canonical_reason().unwrap_or("Error").to_owned(),
            status: status.as_u16(),
            code,
            detail: detail.into(),
            field: None,
            retry_after_s: None,
        }
    }

    /// Makes the problem of a value that is not accepted.
    pub fn refused(field: &str, value: &str, accepted: &str) -> Self {
        let shown: String = value.chars().take(100).collect();
        let detail = format!("{field}: got {shown:?}, expected {accepted}");
        Self::new(StatusCode::BAD_REQUEST, "value_refused", detail).of_field(field)
    }

    /// Makes the problem of an unknown address.
    pub fn not_found(path: &str) -> Self {
        Self::new(
            StatusCode::NOT_FOUND,
            "not_found",
            format!("nothing is at {path}"),
        )
    }

    /// Makes the problem of an address that does not support this method.
    pub fn method_refused(method: &Method, path: &str) -> Self {
        let detail = format!("{method} is not answered at {path}");
        Self::new(StatusCode::METHOD_NOT_ALLOWED, "method_refused", detail)
    }

    /// Makes the problem of a request whose handler failed.
    pub fn panicked() -> Self {
        let detail = "the service failed; its log has the details";
        Self::new(StatusCode::INTERNAL_SERVER_ERROR, "failed", detail)
    }

    /// Makes the problem of an unknown robot.
    pub fn robot_unknown(id: &str) -> Self {
        let detail = format!("no robot {id} is known");
        Self::new(StatusCode::NOT_FOUND, "robot_unknown", detail)
    }

    /// Makes the problem of a request that took too long.
    pub fn timed_out() -> Self {
        let detail = "the request could not be answered in time";
        Self::new(StatusCode::SERVICE_UNAVAILABLE, "timeout", detail)
    }

    /// Makes the problem of a change that took too long or failed at its very end.
    pub fn outcome_unknown() -> Self {
        let detail = "the database did not confirm the change in time: it may or may not have been \
                      made; read again before you repeat it";
        Self::new(StatusCode::SERVICE_UNAVAILABLE, "outcome_unknown", detail)
    }

    /// Returns the HTTP status.
    pub fn status(&self) -> StatusCode {
        StatusCode::from_u16(self.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR)
    }

    /// Returns the sentence for people.
    pub fn detail(&self) -> &str {
        &self.detail
    }

    /// Returns the parameter, field or header that the problem is about.
    pub fn field(&self) -> Option<&str> {
        self.field.as_deref()
    }

    /// Adds the seconds to wait before the next attempt.
    #[must_use]
    pub fn retry_after(mut self, seconds: u32) -> Self {
        self.retry_after_s = Some(seconds);
        self
    }

    /// Adds the parameter, field or header that the problem is about.
    #[must_use]
    pub fn of_field(mut self, field: &str) -> Self {
        self.field = Some(field.to_owned());
        self
    }
}

impl From<StoreError> for Problem {
    fn from(error: StoreError) -> Self {
        let detail = error.to_string();
        match error {
            StoreError::VersionConflict { .. } => {
                Self::new(StatusCode::PRECONDITION_FAILED, "version_conflict", detail)
            }
            StoreError::RobotsMax { .. } => Self::new(StatusCode::CONFLICT, "fleet_full", detail),
            StoreError::KeyReused => Self::new(
                StatusCode::UNPROCESSABLE_ENTITY,
                "idempotency_key_reused",
                detail,
            )
            .of_field("Idempotency-Key"),
            StoreError::Fenced(_) => {
                Self::new(StatusCode::SERVICE_UNAVAILABLE, "robot_moved", detail).retry_after(1)
            }
            StoreError::Account(refused) => refused.into(),
            StoreError::Refused(refused) => refused.into(),
            StoreError::Alert(refused) => refused.into(),
            StoreError::Rollout(refused) => refused.into(),
            StoreError::Webhook(refused) => refused.into(),
            StoreError::Corrupt { .. } => {
                tracing::error!(%detail, "a row of the database cannot be read");
                Self::new(
                    StatusCode::INTERNAL_SERVER_ERROR,
                    "database_corrupt",
                    detail,
                )
            }
            // The database may hold it all the same, and finds it when it is opened the next time.
            StoreError::Commit(source) => {
                tracing::error!(%source, "the database failed while it committed");
                Self::outcome_unknown()
            }
            other => {
                let source = std::error::Error::source(&other).map(ToString::to_string);
                tracing::error!(%detail, ?source, "the database failed a request");
                Self::new(
                    StatusCode::SERVICE_UNAVAILABLE,
                    "database_unavailable",
                    detail,
                )
            }
        }
    }
}

impl From<AccountRefused> for Problem {
    fn from(refused: AccountRefused) -> Self {
        let (status, code) = match &refused {
            AccountRefused::UserUnknown(_) => (StatusCode::NOT_FOUND, "user_unknown"),
            AccountRefused::TokenUnknown(_) => (StatusCode::NOT_FOUND, "token_unknown"),
            AccountRefused::SessionUnknown => (StatusCode::UNAUTHORIZED, "session_ended"),
            AccountRefused::NameTaken(_) => (StatusCode::CONFLICT, "name_taken"),
            AccountRefused::VersionConflict { .. } => {
                (StatusCode::PRECONDITION_FAILED, "version_conflict")
            }
            AccountRefused::LastAdmin => (StatusCode::CONFLICT, "last_admin"),
            AccountRefused::AlreadySetUp => (StatusCode::CONFLICT, "already_set_up"),
            AccountRefused::Full { .. } => (StatusCode::CONFLICT, "full"),
        };
        Self::new(status, code, refused.to_string())
    }
}

impl From<Refused> for Problem {
    fn from(refused: Refused) -> Self {
        let detail = refused.to_string();
        let conflict = |code| Self::new(StatusCode::CONFLICT, code, detail.clone());
        let value = |field: &str| {
            Self::new(StatusCode::BAD_REQUEST, "value_refused", detail.clone()).of_field(field)
        };
        match refused {
            Refused::Stale { .. } => {
                Self::new(StatusCode::PRECONDITION_FAILED, "version_conflict", detail)
            }
            Refused::OtherRevision { .. } => {
                Self::new(StatusCode::PRECONDITION_FAILED, "other_revision", detail)
                    .of_field("sha256")
            }
            Refused::OwnProposal(_) | Refused::ApprovedAlready(_) => {
                Self::new(StatusCode::FORBIDDEN, "second_person_needed", detail)
            }
            Refused::ProposalClosed { .. } | Refused::NotOpen(_) => conflict("proposal_closed"),
            Refused::Deployment { .. } | Refused::NotUnderway(_) => conflict("wrong_state"),
            Refused::Underway { .. } | Refused::UnderwayAtRetirement { .. } => {
                conflict("deployment_underway")
            }
            Refused::Outdated(_) => conflict("proposal_outdated"),
            Refused::ReassemblyOpen => conflict("reassembly_open"),
            Refused::TwoSenders => conflict("two_senders"),
            Refused::NoMaintenance => conflict("not_in_maintenance"),
            Refused::Retired { .. } => conflict("robot_retired"),
            Refused::NotRetired => conflict("robot_not_retired"),
            Refused::StillSends => conflict("robot_sends"),
            Refused::OutOfLimits { field, .. } => value(field),
            Refused::ReasonMissing => value("reason"),
            Refused::NothingToReturnTo | Refused::NothingEarlier => {
                conflict("nothing_to_return_to")
            }
            Refused::Held(_) => conflict("frozen"),
            Refused::NeverOffered { .. } => value("generation"),
            Refused::OtherDocument { .. } => value("sha256"),
            Refused::ChosenByPerson { .. } => conflict("chosen_by_person"),
            Refused::AnswersContradict { .. } => conflict("answers_contradict"),
            Refused::Seal(_) => Self::new(StatusCode::INTERNAL_SERVER_ERROR, "not_signed", detail),
        }
    }
}

impl From<AlertRefused> for Problem {
    fn from(refused: AlertRefused) -> Self {
        let detail = refused.to_string();
        let (status, code) = match refused {
            AlertRefused::Unknown(_) => (StatusCode::NOT_FOUND, "alert_unknown"),
            AlertRefused::Stale { .. } => (StatusCode::PRECONDITION_FAILED, "version_conflict"),
            AlertRefused::AcknowledgedAlready(_) => (StatusCode::CONFLICT, "acknowledged_already"),
            AlertRefused::Newer => (StatusCode::CONFLICT, "alert_newer"),
        };
        Self::new(status, code, detail)
    }
}

impl From<RolloutRefused> for Problem {
    fn from(refused: RolloutRefused) -> Self {
        let detail = refused.to_string();
        let (status, code) = match refused {
            RolloutRefused::Unknown(_) => (StatusCode::NOT_FOUND, "rollout_unknown"),
            RolloutRefused::Stale { .. } | RolloutRefused::MoreLost { .. } => {
                (StatusCode::PRECONDITION_FAILED, "version_conflict")
            }
            RolloutRefused::Taken { .. } => (StatusCode::CONFLICT, "robot_taken"),
            RolloutRefused::TooMany => (StatusCode::CONFLICT, "too_many"),
            RolloutRefused::State { .. } | RolloutRefused::NotReleased => {
                (StatusCode::CONFLICT, "wrong_state")
            }
            RolloutRefused::MayNotApprove(_) => (StatusCode::FORBIDDEN, "not_permitted"),
            RolloutRefused::ReasonMissing => {
                let status = StatusCode::BAD_REQUEST;
                return Self::new(status, "value_refused", detail).of_field("reason");
            }
        };
        Self::new(status, code, detail)
    }
}

impl From<WebhookRefused> for Problem {
    fn from(refused: WebhookRefused) -> Self {
        let detail = refused.to_string();
        match refused {
            WebhookRefused::Unknown(_) => {
                Self::new(StatusCode::NOT_FOUND, "webhook_unknown", detail)
            }
            WebhookRefused::Url { .. } => {
                Self::new(StatusCode::BAD_REQUEST, "value_refused", detail).of_field("url")
            }
            WebhookRefused::UrlTaken(_) => {
                Self::new(StatusCode::CONFLICT, "webhook_exists", detail).of_field("url")
            }
            WebhookRefused::TooMany => Self::new(StatusCode::CONFLICT, "webhooks_full", detail),
        }
    }
}

impl From<FleetRefused> for Problem {
    fn from(refused: FleetRefused) -> Self {
        let detail = refused.to_string();
        match refused {
            FleetRefused::UnknownRobot(_) => {
                Self::new(StatusCode::NOT_FOUND, "robot_unknown", detail)
            }
            FleetRefused::Unregistered(_) => {
                Self::new(StatusCode::CONFLICT, "robot_unregistered", detail)
            }
            FleetRefused::Registered(_) => {
                Self::new(StatusCode::CONFLICT, "robot_registered", detail)
            }
            FleetRefused::Retired(_) => Self::new(StatusCode::CONFLICT, "robot_retired", detail),
            FleetRefused::RobotsMax => Self::new(StatusCode::CONFLICT, "fleet_full", detail),
            FleetRefused::Stopped(_) => {
                Self::new(StatusCode::CONFLICT, "estimator_stopped", detail)
            }
            FleetRefused::PreviewFailed(_) => {
                Self::new(StatusCode::INTERNAL_SERVER_ERROR, "preview_failed", detail)
            }
            FleetRefused::Elsewhere(_) => {
                Self::new(StatusCode::SERVICE_UNAVAILABLE, "robot_elsewhere", detail)
            }
            FleetRefused::NotesMax(_)
            | FleetRefused::TopViewAskersMax(_)
            | FleetRefused::PreviewsMax(_) => {
                Self::new(StatusCode::SERVICE_UNAVAILABLE, "robot_busy", detail)
            }
        }
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let status = self.status();
        let retry_after_s = self.retry_after_s;
        let mut response = (status, Json(self)).into_response();
        let headers = response.headers_mut();
        let problem = HeaderValue::from_static("application/problem+json");
        headers.insert(header::CONTENT_TYPE, problem);
        let retry_after_s =
            retry_after_s.or((status == StatusCode::SERVICE_UNAVAILABLE).then_some(RETRY_AFTER_S));
        if let Some(seconds) = retry_after_s {
            headers.insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        if status == StatusCode::UNAUTHORIZED {
            let challenge = HeaderValue::from_static("Bearer realm=\"fleetcal\"");
            headers.insert(header::WWW_AUTHENTICATE, challenge);
        }
        response
    }
}
