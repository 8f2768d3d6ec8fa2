//! Changes of users and of their sessions.

use async_trait::async_trait;
use fleetcal_domain::access::{
    AccountName, AccountRefused, Actor, Grant, PasswordHash, Role, SecretHash, allow_change,
    allow_new_user, allow_set_up, counts_as_admin, ended_before,
};
use fleetcal_domain::audit::Action;
use fleetcal_domain::limits;
use fleetcal_model::{UserId, Version, WallTime};
use fleetcal_store::transaction::AnswerScope;
use fleetcal_store::{
    AuditEntry, Expected, IdempotencyKey, Job, Records, StoreError, UserRecord, Written,
};
use serde_json::{Value, json};

use crate::answers::{made_before, note_made};

/// Change of a user, or of a user's sessions.
#[derive(Debug, Clone)]
pub struct ChangeUser {
    /// Actor of the change.
    pub actor: Actor,
    /// Time of the change, wall time.
    pub now: WallTime,
    /// Kind of change.
    pub change: UserChange,
}

/// Kind of change of a user.
#[derive(Debug, Clone)]
pub enum UserChange {
    /// Creation of a user.
    Create {
        /// Name.
        name: AccountName,
        /// Role.
        grant: Grant,
        /// Password.
        password: PasswordHash,
        /// Idempotency key of the request.
        key: Option<IdempotencyKey>,
    },
    /// Creation of the first administrator, signed in; refused if there is any user.
    SetUp {
        /// Name.
        name: AccountName,
        /// Password.
        password: PasswordHash,
        /// Session of the browser.
        session: SecretHash,
    },
    /// Change of role, password or `disabled`. Sessions end, unless the role alone changes.
    Edit {
        /// Number of the user.
        id: UserId,
        /// Version that the caller read.
        expected: Expected,
        /// New values.
        edit: UserEdit,
        /// Session that continues, if any.
        keep: Option<SecretHash>,
    },
    /// Removal of a user.
    Remove {
        /// Number of the user.
        id: UserId,
        /// Version that the caller read.
        expected: Expected,
    },
    /// Sign-in of a user whose password was right at `version`.
    SignIn {
        /// Number of the user.
        id: UserId,
        /// Version whose password was right.
        version: Version,
        /// Session of the browser.
        session: SecretHash,
    },
    /// Sign-out: the end of a session.
    SignOut {
        /// Session to end.
        session: SecretHash,
    },
}

/// New values of a user; `None` keeps the old one.
#[derive(Debug, Clone, Default)]
pub struct UserEdit {
    /// Role.
    pub grant: Option<Grant>,
    /// Password.
    pub password: Option<PasswordHash>,
    /// True if signing in is refused.
    pub disabled: Option<bool>,
}

#[async_trait]
impl Job for ChangeUser {
    type Done = Written<UserRecord>;

    async fn run(&self, records: &mut dyn Records) -> Result<Self::Done, StoreError> {
        let record = match &self.change {
            UserChange::Create {
                name,
                grant,
                password,
                key,
            } => {
                return self
                    .create(records, (name, grant, password), key.as_ref())
                    .await;
            }
            UserChange::SetUp {
                name,
                password,
                session,
            } => self.set_up(records, (name, password), session).await?,
            UserChange::Edit {
                id,
                expected,
                edit,
                keep,
            } => {
                let before = expected_user(records, *id, *expected).await?;
                self.edit(records, before, edit, keep.as_ref()).await?
            }
            UserChange::Remove { id, expected } => {
                let before = expected_user(records, *id, *expected).await?;
                self.remove(records, before).await?
            }
            UserChange::SignIn {
                id,
                version,
                session,
            } => self.sign_in(records, (*id, *version), session).await?,
            UserChange::SignOut { session } => self.sign_out(records, session).await?,
        };
        Ok(Written {
            record,
            repeated: false,
        })
    }
}

impl ChangeUser {
    async fn create(
        &self,
        records: &mut dyn Records,
        new: (&AccountName, &Grant, &PasswordHash),
        key: Option<&IdempotencyKey>,
    ) -> Result<Written<UserRecord>, StoreError> {
        if let Some(id) = made_before(records, AnswerScope::User, key).await? {
            return Ok(Written {
                record: known(records, UserId(id)).await?,
                repeated: true,
            });
        }
        let record = self.add(records, new).await?;
        note_made(records, AnswerScope::User, key, record.id.0, self.now).await?;
        self.audit(records, Action::CreateUser, None, Some(&record))
            .await?;
        Ok(Written {
            record,
            repeated: false,
        })
    }

    async fn add(
        &self,
        records: &mut dyn Records,
        (name, grant, password): (&AccountName, &Grant, &PasswordHash),
    ) -> Result<UserRecord, StoreError> {
        let users = records.count_users().await?;
        let taken = records.user_named(name).await?;
        allow_new_user(users, name, taken.is_some())?;
        let mut user = UserRecord {
            id: UserId(0),
            name: name.clone(),
            grant: grant.clone(),
            password: password.clone(),
            disabled: false,
            version: Version(1),
            created_ns: self.now,
            updated_ns: self.now,
            signed_in_ns: None,
        };
        user.id = records.add_user(&user).await?;
        Ok(user)
    }

    async fn set_up(
        &self,
        records: &mut dyn Records,
        (name, password): (&AccountName, &PasswordHash),
        session: &SecretHash,
    ) -> Result<UserRecord, StoreError> {
        allow_set_up(records.count_users().await?)?;
        let admin = Grant::of_person(Role::Admin).map_err(|error| StoreError::Corrupt {
            table: "user",
            reason: error.to_string(),
        })?;
        let user = self.add(records, (name, &admin, password)).await?;
        records.keep_setup_codes(0).await?;
        let user = self.begin_session(records, user, session).await?;
        self.audit(records, Action::SetUp, None, Some(&user))
            .await?;
        Ok(user)
    }

    async fn edit(
        &self,
        records: &mut dyn Records,
        before: UserRecord,
        edit: &UserEdit,
        keep: Option<&SecretHash>,
    ) -> Result<UserRecord, StoreError> {
        let mut after = before.clone();
        after.grant = edit.grant.clone().unwrap_or(after.grant);
        after.password = edit.password.clone().unwrap_or(after.password);
        after.disabled = edit.disabled.unwrap_or(after.disabled);
        after.version = after.version.next();
        after.updated_ns = self.now;
        let stays_admin = counts_as_admin(&after.grant, after.disabled);
        check_admin_stays(records, &before, stays_admin).await?;
        records.save_user(&after).await?;
        if after.disabled || edit.password.is_some() {
            records.delete_sessions(after.id, keep).await?;
        }
        let action = match (&edit.password, &edit.grant, edit.disabled) {
            (Some(_), None, None) => Action::ChangePassword,
            _ => Action::EditUser,
        };
        self.audit(records, action, Some(&before), Some(&after))
            .await?;
        Ok(after)
    }

    async fn remove(
        &self,
        records: &mut dyn Records,
        before: UserRecord,
    ) -> Result<UserRecord, StoreError> {
        check_admin_stays(records, &before, false).await?;
        records.delete_user(before.id).await?;
        self.audit(records, Action::RemoveUser, Some(&before), None)
            .await?;
        Ok(before)
    }

    async fn sign_in(
        &self,
        records: &mut dyn Records,
        (id, version): (UserId, Version),
        session: &SecretHash,
    ) -> Result<UserRecord, StoreError> {
        // Since the password was compared the user may have been disabled, or have got another one.
        let before = expected_user(records, id, Expected::Version(version)).await?;
        if before.disabled {
            return Err(AccountRefused::UserUnknown(id).into());
        }
        let after = self.begin_session(records, before, session).await?;
        self.audit(records, Action::SignIn, None, Some(&after))
            .await?;
        Ok(after)
    }

    /// Adds a session; deletes ended ones, and the oldest of a user who has too many.
    async fn begin_session(
        &self,
        records: &mut dyn Records,
        user: UserRecord,
        session: &SecretHash,
    ) -> Result<UserRecord, StoreError> {
        let (created_ns, used_ns) = ended_before(self.now);
        records.delete_old_sessions(created_ns, used_ns).await?;
        let others = limits::SESSIONS_PER_USER_MAX - 1;
        records.keep_sessions(user.id, others).await?;
        records.add_session(user.id, session, self.now).await?;
        let user = UserRecord {
            signed_in_ns: Some(self.now),
            ..user
        };
        records.save_user(&user).await?;
        Ok(user)
    }

    async fn sign_out(
        &self,
        records: &mut dyn Records,
        session: &SecretHash,
    ) -> Result<UserRecord, StoreError> {
        let id = records.delete_session(session).await?;
        let id = id.ok_or(AccountRefused::SessionUnknown)?;
        let user = known(records, id).await?;
        self.audit(records, Action::SignOut, Some(&user), None)
            .await?;
        Ok(user)
    }

    async fn audit(
        &self,
        records: &mut dyn Records,
        action: Action,
        before: Option<&UserRecord>,
        after: Option<&UserRecord>,
    ) -> Result<(), StoreError> {
        let subject = after.or(before);
        let entry = AuditEntry {
            at_ns: self.now,
            actor: self.actor.clone(),
            action,
            subject_id: subject.map_or_else(String::new, |user| user.id.to_string()),
            robot: None,
            before: before.map(shown),
            after: after.map(shown),
            reason: None,
        };
        records.append_audit(&entry).await
    }
}

/// Refuses a change that would leave no administrator.
async fn check_admin_stays(
    records: &mut dyn Records,
    user: &UserRecord,
    stays_admin: bool,
) -> Result<(), StoreError> {
    let admins = records.count_admins().await?;
    let was_admin = counts_as_admin(&user.grant, user.disabled);
    Ok(allow_change(was_admin, stays_admin, admins)?)
}

async fn expected_user(
    records: &mut dyn Records,
    id: UserId,
    expected: Expected,
) -> Result<UserRecord, StoreError> {
    let user = known(records, id).await?;
    if expected.accepts(user.version) {
        Ok(user)
    } else {
        let found = user.version;
        Err(AccountRefused::VersionConflict { id, found }.into())
    }
}

async fn known(records: &mut dyn Records, id: UserId) -> Result<UserRecord, StoreError> {
    let user = records.user(id).await?;
    Ok(user.ok_or(AccountRefused::UserUnknown(id))?)
}

/// Record of a user for the audit, without the password's hash.
fn shown(user: &UserRecord) -> Value {
    json!({
        "name": user.name,
        "role": user.grant.role(),
        "disabled": user.disabled,
        "version": user.version,
    })
}
