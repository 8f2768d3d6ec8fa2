//! Audit of an action. Its text, and the kind of record that it was done to, follow from
//! one closed type.

use strum::IntoStaticStr;

use crate::approval::{DeploymentAction, ProposalAction, ShadowAction, Transition};

/// What was done. The text is the audit's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, IntoStaticStr)]
pub enum Action {
    /// To a proposal.
    Proposal(ProposalAction),
    /// To a deployment.
    Deployment(DeploymentAction),
    /// To what a robot should use and what it reported.
    Shadow(ShadowAction),
    /// The first administrator was made.
    #[strum(serialize = "user.set_up")]
    SetUp,
    /// A user was made.
    #[strum(serialize = "user.create")]
    CreateUser,
    /// A user's password changed, and nothing else.
    #[strum(serialize = "user.password")]
    ChangePassword,
    /// A user changed.
    #[strum(serialize = "user.edit")]
    EditUser,
    /// A user was removed.
    #[strum(serialize = "user.remove")]
    RemoveUser,
    /// A user signed in.
    #[strum(serialize = "session.sign_in")]
    SignIn,
    /// A user signed out.
    #[strum(serialize = "session.sign_out")]
    SignOut,
    /// A token was made.
    #[strum(serialize = "token.create")]
    CreateToken,
    /// A token was revoked.
    #[strum(serialize = "token.revoke")]
    RevokeToken,
    /// A robot got its first configuration.
    #[strum(serialize = "robot.register")]
    RegisterRobot,
    /// A robot's configuration changed.
    #[strum(serialize = "robot.configure")]
    ConfigureRobot,
    /// Somebody noted an event.
    #[strum(serialize = "event.note")]
    NoteEvent,
    /// Somebody took an alert on.
    #[strum(serialize = "alert.acknowledge")]
    AcknowledgeAlert,
    /// A webhook was made.
    #[strum(serialize = "webhook.create")]
    CreateWebhook,
    /// A webhook was deleted.
    #[strum(serialize = "webhook.delete")]
    DeleteWebhook,
    /// Deployments were frozen.
    #[strum(serialize = "freeze.begin")]
    BeginFreeze,
    /// Deployments were resumed.
    #[strum(serialize = "freeze.end")]
    EndFreeze,
    /// The approval policy was set.
    #[strum(serialize = "policy.change")]
    ChangePolicy,
}

impl Action {
    /// The text in the audit: `deployment.roll_back`.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Proposal(action) => action.into(),
            Self::Deployment(action) => action.into(),
            Self::Shadow(action) => action.into(),
            other => other.into(),
        }
    }

    /// The kind of record that it is done to, as the audit names it.
    pub const fn subject(self) -> &'static str {
        match self {
            Self::Proposal(_) => "proposal",
            Self::Deployment(_) => "deployment",
            Self::Shadow(_) => "shadow",
            Self::SetUp
            | Self::CreateUser
            | Self::ChangePassword
            | Self::EditUser
            | Self::RemoveUser
            | Self::SignIn
            | Self::SignOut => "user",
            Self::CreateToken | Self::RevokeToken => "token",
            Self::RegisterRobot | Self::ConfigureRobot => "robot",
            Self::NoteEvent => "event",
            Self::AcknowledgeAlert => "alert",
            Self::CreateWebhook | Self::DeleteWebhook => "webhook",
            Self::BeginFreeze | Self::EndFreeze => "freeze",
            Self::ChangePolicy => "policy",
        }
    }
}

impl Transition {
    /// What was done, for the audit.
    pub const fn action(&self) -> Action {
        match self {
            Self::Proposal(change) => Action::Proposal(change.action),
            Self::Deployment(change) => Action::Deployment(change.action),
            Self::Shadow(change) => Action::Shadow(change.action),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_action_is_named_as_in_stored_rows() {
        for (action, name, subject) in [
            (
                Action::Deployment(DeploymentAction::RollBack),
                "deployment.roll_back",
                "deployment",
            ),
            (
                Action::Shadow(ShadowAction::BeginMaintenance),
                "maintenance.begin",
                "shadow",
            ),
            (Action::SignIn, "session.sign_in", "user"),
            (Action::EndFreeze, "freeze.end", "freeze"),
        ] {
            assert_eq!((action.as_str(), action.subject()), (name, subject));
        }
    }
}
