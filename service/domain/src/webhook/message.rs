//! Message to a webhook.

use fleetcal_model::{ProposalId, RolloutId, Version, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::CalibrationValues;
use jiff::Timestamp;
use serde::Serialize;

use super::record::WebhookEvent;
use crate::alert::{Alert, AlertDocument, Notice};
use crate::approval::{Outcome, Proposal, ProposalAction, Revision, Transition};
use crate::standing::Standing;
use crate::timestamp;

/// Message before it is signed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// Event that it reports.
    pub event: WebhookEvent,
    /// Subject, from which the webhook's secret makes the `webhook-id`.
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

/// Alert with the standing of its robot.
#[derive(Serialize)]
struct Told {
    #[serde(flatten)]
    alert: AlertDocument,
    /// Standing of the robot; `null` for an alert about several.
    standing: Option<Standing>,
}

/// Proposal that awaits approval.
#[derive(Serialize)]
struct Waiting<'a> {
    id: ProposalId,
    robot: &'a RobotId,
    version: Version,
    /// Standing of the robot; `null` for one that sends nothing and is not configured.
    standing: Option<Standing>,
    proposed_by: &'a str,
    reason: Option<&'a str>,
    expires: Timestamp,
    approvals_needed: u32,
    /// Values in use; `null` if unknown.
    base: Option<CalibrationValues>,
    values: Option<CalibrationValues>,
    sigmas: Option<CalibrationValues>,
}

/// Roll-out that has halted.
#[derive(Serialize)]
struct Halted<'a> {
    id: RolloutId,
    version: Version,
    /// Person or token that halted it, or the service.
    by: &'a str,
    reason: &'a str,
}

impl Message {
    /// Message about an alert, with its robot's standing.
    ///
    /// # Errors
    /// If it cannot be written as JSON.
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

    /// Message about a proposal that awaits approval, with its robot's standing.
    ///
    /// # Errors
    /// If it cannot be written as JSON.
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

    /// Message about a roll-out that has halted in this version.
    ///
    /// # Errors
    /// If it cannot be written as JSON.
    pub fn of_halted_rollout(
        (id, version): (RolloutId, Version),
        by: &str,
        reason: &str,
        now: WallTime,
    ) -> Result<Self, serde_json::Error> {
        let data = Halted {
            id,
            version,
            by,
            reason,
        };
        let subject = format!("rollout-{id}-{version}");
        Self::new(WebhookEvent::RolloutHalted, subject, data, now)
    }

    /// Message about a transition of `outcome`; `None` for one that is not published.
    ///
    /// # Errors
    /// If it cannot be written as JSON.
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
