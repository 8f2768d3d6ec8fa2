//! Audit of an action. Its text and the kind of its record follow from one closed type.

use strum::IntoStaticStr;

use crate::approval::{DeploymentAction, ProposalAction, ShadowAction, Transition};

/// Action in the audit. The text is the audit's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, IntoStaticStr)]
pub enum Action {
    /// Action on a proposal.
    Proposal(ProposalAction),
    /// Action on a deployment.
    Deployment(DeploymentAction),
    /// Action on a shadow (desired and reported calibration).
    Shadow(ShadowAction),
    /// Creation of the first administrator.
    #[strum(serialize = "user.set_up")]
    SetUp,
    /// Creation of a user.
    #[strum(serialize = "user.create")]
    CreateUser,
    /// Change of a user's password alone.
    #[strum(serialize = "user.password")]
    ChangePassword,
    /// Change of a user.
    #[strum(serialize = "user.edit")]
    EditUser,
    /// Removal of a user.
    #[strum(serialize = "user.remove")]
    RemoveUser,
    /// Sign-in of a user.
    #[strum(serialize = "session.sign_in")]
    SignIn,
    /// Sign-out of a user.
    #[strum(serialize = "session.sign_out")]
    SignOut,
    /// Creation of a token.
    #[strum(serialize = "token.create")]
    CreateToken,
    /// Revocation of a token.
    #[strum(serialize = "token.revoke")]
    RevokeToken,
    /// First configuration of a robot.
    #[strum(serialize = "robot.register")]
    RegisterRobot,
    /// Change of a robot's configuration.
    #[strum(serialize = "robot.configure")]
    ConfigureRobot,
    /// Note about a robot.
    #[strum(serialize = "event.note")]
    NoteEvent,
    /// Acknowledgement of an alert.
    #[strum(serialize = "alert.acknowledge")]
    AcknowledgeAlert,
    /// Creation of a webhook.
    #[strum(serialize = "webhook.create")]
    CreateWebhook,
    /// Removal of a webhook.
    #[strum(serialize = "webhook.delete")]
    DeleteWebhook,
    /// Begin of a deployment freeze.
    #[strum(serialize = "freeze.begin")]
    BeginFreeze,
    /// End of a deployment freeze.
    #[strum(serialize = "freeze.end")]
    EndFreeze,
    /// Start of a roll-out.
    #[strum(serialize = "rollout.start")]
    StartRollout,
    /// Pause of a roll-out.
    #[strum(serialize = "rollout.pause")]
    PauseRollout,
    /// Continuation of a roll-out.
    #[strum(serialize = "rollout.resume")]
    ResumeRollout,
    /// Halt of a roll-out.
    #[strum(serialize = "rollout.halt")]
    HaltRollout,
    /// Begin of a roll-out's next wave.
    #[strum(serialize = "rollout.begin_wave")]
    BeginWave,
    /// End of a roll-out.
    #[strum(serialize = "rollout.finish")]
    FinishRollout,
    /// Change of the approval policy.
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

    /// Kind of the record that it acts on, as the audit names it.
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
            Self::StartRollout
            | Self::PauseRollout
            | Self::ResumeRollout
            | Self::HaltRollout
            | Self::BeginWave
            | Self::FinishRollout => "rollout",
            Self::ChangePolicy => "policy",
        }
    }
}

impl Transition {
    /// Action of the transition, for the audit.
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
