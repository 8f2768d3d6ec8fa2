//! Message to a webhook.

use fleetcal_model::{ProposalId, Version, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::CalibrationValues;
use jiff::Timestamp;
use serde::Serialize;

use super::record::WebhookEvent;
use crate::alert::{Alert, AlertDocument, Notice};
use crate::approval::{Outcome, Proposal, ProposalAction, Revision, Transition};
use crate::standing::Standing;
use crate::timestamp;

/// A message before it is signed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// What it tells.
    pub event: WebhookEvent,
    /// What it is about: with the webhook's secret this gives the `webhook-id`.
    pub subject: String,
    /// The body.
    pub body: String,
}

#[derive(Serialize)]
struct Body<T> {
    #[serde(rename = "type")]
    event: WebhookEvent,
    timestamp: Timestamp,
    data: T,
}

/// An alert, and how its robot stands with it.
#[derive(Serialize)]
struct Told {
    #[serde(flatten)]
    alert: AlertDocument,
    /// `null` of an alert that is about several robots.
    standing: Option<Standing>,
}

/// A proposal that waits for people.
#[derive(Serialize)]
struct Waiting<'a> {
    id: ProposalId,
    robot: &'a RobotId,
    version: Version,
    /// How the robot stands; `null` of one that sends nothing and is not configured.
    standing: Option<Standing>,
    proposed_by: &'a str,
    reason: Option<&'a str>,
    expires: Timestamp,
    approvals_needed: u32,
    /// What the robot uses now; `null` when nobody knows.
    base: Option<CalibrationValues>,
    values: Option<CalibrationValues>,
    sigmas: Option<CalibrationValues>,
}

impl Message {
    /// What is told of an alert, with how its robot stands.
    ///
    /// # Errors
    /// When it cannot be written as JSON.
    pub fn of_alert(
        alert: &Alert,
        notice: Notice,
        standing: Option<Standing>,
        now: WallTime,
    ) -> Result<Self, serde_json::Error> {
        let event = match notice {
            Notice::Alerting => WebhookEvent::AlertAlerting,
            Notice::Resolved => WebhookEvent::AlertResolved,
        };
        let subject = format!("alert-{}-{}", alert.id, alert.version);
        let alert = AlertDocument::of(alert);
        Self::new(event, subject, Told { alert, standing }, now)
    }

    /// What is told of a proposal that waits, with how its robot stands.
    ///
    /// # Errors
    /// When it cannot be written as JSON.
    pub fn of_proposal(
        proposal: &Proposal,
        revision: Option<&Revision>,
        standing: Option<Standing>,
        now: WallTime,
    ) -> Result<Self, serde_json::Error> {
        let data = Waiting {
            id: proposal.id,
            robot: &proposal.robot,
            version: proposal.version,
            standing,
            proposed_by: &proposal.proposed_by,
            reason: proposal.reason.as_deref(),
            expires: timestamp::of(proposal.expires_ns),
            approvals_needed: proposal.approvals_needed,
            base: proposal.base,
            values: revision.map(|revision| revision.values),
            sigmas: revision.map(|revision| revision.sigmas),
        };
        let subject = format!("proposal-{}-{}", proposal.id, proposal.version);
        Self::new(WebhookEvent::ProposalWaiting, subject, data, now)
    }

    /// What is told of a transition of `outcome`; `None` of one that nobody is told of.
    ///
    /// # Errors
    /// When it cannot be written as JSON.
    pub fn of_transition(
        transition: &Transition,
        outcome: &Outcome,
        standing: Option<Standing>,
        now: WallTime,
    ) -> Result<Option<Self>, serde_json::Error> {
        match transition {
            Transition::Proposal(change) => match change.action {
                ProposalAction::Create | ProposalAction::Refresh => {
                    let revision = outcome.ledger.revisions.get(&change.after.revision);
                    Self::of_proposal(&change.after, revision, standing, now).map(Some)
                }
                ProposalAction::Approve
                | ProposalAction::ApproveInPart
                | ProposalAction::Reject
                | ProposalAction::Expire
                | ProposalAction::Withdraw
                | ProposalAction::Supersede => Ok(None),
            },
            Transition::Deployment(_) | Transition::Shadow(_) => Ok(None),
        }
    }

    fn new<T: Serialize>(
        event: WebhookEvent,
        subject: String,
        data: T,
        now: WallTime,
    ) -> Result<Self, serde_json::Error> {
        let body = Body {
            event,
            timestamp: timestamp::of(now),
            data,
        };
        Ok(Self {
            event,
            subject,
            body: serde_json::to_string(&body)?,
        })
    }
}
