//! Number of approvers, by the distance of a change from values that people here vouch for.
//!
//! 1. A change is measured from the last calibration approved here for its robot; before any
//!    approval from the drawing. It is also measured from the values that the robot reports, which
//!    make it larger and never smaller.
//! 2. A drawing does not count for its author: nobody who proposes or approves moves the mark that
//!    their own change is measured from.
//! 3. With nothing to measure from, the change is as large as any.

use super::draft::Draft;
use super::ledger::RobotLedger;
use super::proposal::Proposal;
use super::revision::{Origin, Revision};
use super::second_approver::SecondApprover;
use super::values::{difference, differs_beside, exceeds};

impl RobotLedger {
    /// Revision that people here vouch for: the last one approved, or verified. A return to values
    /// that a robot has reported of itself counts once it is verified.
    fn vouched(&self) -> Option<&Revision> {
        let revision = |id| self.revisions.get(id);
        let desired = self.shadow.desired.iter();
        let approved = desired.filter_map(|one| revision(&one.revision));
        let verified = self.shadow.verified.iter().rev();
        let verified = verified.filter_map(|one| revision(&one.revision));
        let mut vouched = approved
            .filter(|one| one.origin != Origin::Robot)
            .chain(verified);
        vouched.next()
    }
}

impl Draft<'_> {
    /// Author of the drawing that changes of this robot are measured from now.
    pub(super) fn drawn_by(&self) -> Option<String> {
        let drawing = self.standing.drawing.as_ref();
        let measures = self.outcome.ledger.vouched().is_none();
        drawing.filter(|_| measures)?.by.clone()
    }

    /// Reason for which a change that `involved` propose and approve needs a second approver, if
    /// any.
    pub(super) fn second_approver(
        &self,
        to: &Revision,
        involved: &[&str],
    ) -> Option<SecondApprover> {
        let ledger = &self.outcome.ledger;
        let drawing = self.standing.drawing.as_ref();
        let others = drawing.filter(|drawing| !is_among(drawing.by.as_deref(), involved));
        let vouched = ledger.vouched();
        let mark = vouched.map(|vouched| &vouched.values);
        let mark = mark.or(others.map(|drawing| &drawing.values));
        let in_use = ledger.shadow.in_use.as_ref().map(|in_use| &in_use.values);
        let limits = self.standing.policy.two_approvers_beyond.limits();
        let beyond = |from| exceeds(&difference(from, &to.values), &limits);
        let mut known = vouched.into_iter().chain(ledger.revision_in_use());
        let moves = |known: &Revision| known.rear_axle_in_base_link != to.rear_axle_in_base_link;
        let mut marks = mark.into_iter().chain(in_use);
        if marks.clone().any(beyond) {
            Some(SecondApprover::Beyond)
        } else if marks.any(|from| differs_beside(from, &to.values)) {
            Some(SecondApprover::Vehicle)
        } else if known.any(moves) {
            Some(SecondApprover::Frame)
        } else if mark.is_some() {
            None
        } else if drawing.is_some() {
            Some(SecondApprover::OwnDrawing)
        } else {
            Some(SecondApprover::Unknown)
        }
    }

    /// Reason for which a proposal needs a second approver when `by` approves it now. The rules,
    /// the values in use and the drawing may have changed since it was made, but it never needs
    /// fewer.
    pub(super) fn second_approver_now(
        &self,
        proposal: &Proposal,
        by: &str,
    ) -> Option<SecondApprover> {
        let mut involved = vec![proposal.proposed_by.as_str(), by];
        involved.extend(proposal.approvals.iter().map(|one| one.by.as_str()));
        let own = is_among(proposal.drawn_by.as_deref(), &involved);
        let proposed = self.outcome.ledger.revisions.get(&proposal.revision);
        let now = || self.second_approver(proposed?, &involved);
        let before = proposal.second_approver.or_else(now);
        before.or(own.then_some(SecondApprover::OwnDrawing))
    }
}

fn is_among(name: Option<&str>, involved: &[&str]) -> bool {
    name.is_some_and(|name| involved.contains(&name))
}
