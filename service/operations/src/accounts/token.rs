//! Changes of API tokens.

use async_trait::async_trait;
use fleetcal_domain::access::{
    AccountName, AccountRefused, Actor, Grant, SecretHash, TokenSpan, allow_new_token,
};
use fleetcal_domain::audit::Action;
use fleetcal_model::{TokenId, WallTime};
use fleetcal_store::transaction::AnswerScope;
use fleetcal_store::{AuditEntry, IdempotencyKey, Job, Records, StoreError, TokenRecord, Written};
use serde_json::{Value, json};

use crate::answers::{made_before, note_made};

/// Change of a token.
#[derive(Debug, Clone)]
pub struct ChangeToken {
    /// Actor of the change.
    pub actor: Actor,
    /// Time of the change, wall time.
    pub now: WallTime,
    /// Kind of change.
    pub change: TokenChange,
}

/// Kind of change of a token.
#[derive(Debug, Clone)]
pub enum TokenChange {
    /// Creation of a token.
    Create {
        /// Name.
        name: AccountName,
        /// Role and robot.
        grant: Grant,
        /// Hash of its value.
        hash: SecretHash,
        /// End of its validity, wall time.
        expires_ns: Option<WallTime>,
        /// Idempotency key of the request.
        key: Option<IdempotencyKey>,
    },
    /// Revocation. A token that was revoked before stays as it is.
    Revoke {
        /// Number of the token.
        id: TokenId,
    },
}

#[async_trait]
impl Job for ChangeToken {
    type Done = Written<TokenRecord>;

    async fn run(&self, records: &mut dyn Records) -> Result<Self::Done, StoreError> {
        match &self.change {
            TokenChange::Create {
                name,
                grant,
                hash,
                expires_ns,
                key,
            } => {
                let span = TokenSpan {
                    created_ns: self.now,
                    expires_ns: *expires_ns,
                    revoked_ns: None,
                };
                let token = TokenRecord {
                    id: TokenId(0),
                    name: name.clone(),
                    grant: grant.clone(),
                    hash: *hash,
                    created_by: self.actor.name.clone(),
                    span,
                    used_ns: None,
                };
                self.create(records, token, key.as_ref()).await
            }
            TokenChange::Revoke { id } => self.revoke(records, *id).await,
        }
    }
}

impl ChangeToken {
    async fn create(
        &self,
        records: &mut dyn Records,
        mut token: TokenRecord,
        key: Option<&IdempotencyKey>,
    ) -> Result<Written<TokenRecord>, StoreError> {
        if let Some(id) = made_before(records, AnswerScope::Token, key).await? {
            return Ok(Written {
                record: known(records, TokenId(id)).await?,
                repeated: true,
            });
        }
        let tokens = records.count_tokens().await?;
        let taken = records.token_named(&token.name, self.now).await?;
        allow_new_token(tokens, &token.name, taken.is_some())?;
        token.id = records.add_token(&token).await?;
        note_made(records, AnswerScope::Token, key, token.id.0, self.now).await?;
        self.audit(records, Action::CreateToken, None, &token)
            .await?;
        Ok(Written {
            record: token,
            repeated: false,
        })
    }

    async fn revoke(
        &self,
        records: &mut dyn Records,
        id: TokenId,
    ) -> Result<Written<TokenRecord>, StoreError> {
        let before = known(records, id).await?;
        if before.span.revoked_ns.is_some() {
            return Ok(Written {
                record: before,
                repeated: true,
            });
        }
        records.save_token_revoked(id, self.now).await?;
        let mut after = before.clone();
        after.span.revoked_ns = Some(self.now);
        self.audit(records, Action::RevokeToken, Some(&before), &after)
            .await?;
        Ok(Written {
            record: after,
            repeated: false,
        })
    }

    async fn audit(
        &self,
        records: &mut dyn Records,
        action: Action,
        before: Option<&TokenRecord>,
        after: &TokenRecord,
    ) -> Result<(), StoreError> {
        let entry = AuditEntry {
            at_ns: self.now,
            actor: self.actor.clone(),
            action,
            subject_id: after.id.to_string(),
            robot: after.grant.robot().cloned(),
            before: before.map(shown),
            after: Some(shown(after)),
            reason: None,
        };
        records.append_audit(&entry).await
    }
}

async fn known(records: &mut dyn Records, id: TokenId) -> Result<TokenRecord, StoreError> {
    let token = records.token(id).await?;
    Ok(token.ok_or(AccountRefused::TokenUnknown(id))?)
}

/// Record of a token for the audit, without its hash.
fn shown(token: &TokenRecord) -> Value {
    json!({
        "name": token.name,
        "role": token.grant.role(),
        "robot": token.grant.robot(),
        "expires_ns": token.span.expires_ns,
        "revoked_ns": token.span.revoked_ns,
    })
}
