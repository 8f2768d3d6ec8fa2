//! Users, sessions and tokens.

use std::fmt::Write as _;

use fleetcal_domain::access::{
    AccountName, Grant, PasswordHash, Role, SecretHash, SetupCode, TokenSpan,
};
use fleetcal_model::{TokenId, UserId, Version, WallTime};
use fleetcal_store::{StoreError, TokenRecord, UserRecord};
use rand::Rng;

use super::super::chance::{number, pick, robot, time, words};
use super::super::told::secret;
use super::{Run, ask};

impl Run<'_> {
    fn name(&mut self) -> AccountName {
        let name = pick(
            &mut self.chance,
            &["ann", "bob b.", "eve-1", "zo\u{eb}", "@"],
        );
        let name = match self.chance.random_range(0..3) {
            0 => name.to_ascii_uppercase(),
            _ => name.to_owned(),
        };
        AccountName::parse(&name)
            .or_else(|_| AccountName::parse("dan"))
            .unwrap()
    }

    fn some_user(&mut self) -> UserId {
        UserId(self.chance.random_range(0..6))
    }

    fn user_as(&mut self, id: UserId, name: AccountName, version: Version) -> UserRecord {
        let chance = &mut self.chance;
        let roles = [Role::Viewer, Role::Operator, Role::Approver, Role::Admin];
        UserRecord {
            id,
            name,
            grant: Grant::of_person(pick(chance, &roles)).unwrap(),
            password: PasswordHash::stored(words(chance)),
            disabled: chance.random_bool(0.3),
            version,
            created_ns: WallTime(number(chance)),
            updated_ns: time(chance),
            signed_in_ns: chance.random_bool(0.5).then_some(WallTime(3)),
        }
    }

    pub(super) async fn add_user(&mut self) -> Result<(), StoreError> {
        let name = self.name();
        if ask!(self, user_named(&name)).is_none() {
            let user = self.user_as(UserId(0), name, Version(1));
            ask!(self, add_user(&user));
        }
        ask!(self, count_users());
        ask!(self, count_admins());
        Ok(())
    }

    pub(super) async fn save_user(&mut self) -> Result<(), StoreError> {
        let id = self.some_user();
        if let Some(before) = ask!(self, user(id)) {
            let after = self.user_as(id, before.name, before.version.next());
            ask!(self, save_user(&after));
        }
        ask!(self, user(id));
        Ok(())
    }

    pub(super) async fn delete_user(&mut self) -> Result<(), StoreError> {
        let id = self.some_user();
        ask!(self, delete_user(id));
        ask!(self, count_users());
        Ok(())
    }

    pub(super) async fn add_session(&mut self) -> Result<(), StoreError> {
        let (id, session) = (self.some_user(), secret(&mut self.chance));
        let now = self.now;
        if ask!(self, user(id)).is_some() {
            ask!(self, delete_session(&session));
            ask!(self, add_session(id, &session, now));
        }
        Ok(())
    }

    pub(super) async fn end_sessions(&mut self) -> Result<(), StoreError> {
        let (id, session) = (self.some_user(), secret(&mut self.chance));
        match self.chance.random_range(0..5) {
            0 => {
                ask!(self, delete_session(&session));
            }
            1 => ask!(self, delete_sessions(id, Some(&session))),
            2 => ask!(self, delete_sessions(id, None)),
            3 => {
                let (created_ns, used_ns) = (time(&mut self.chance), time(&mut self.chance));
                ask!(self, delete_old_sessions(created_ns, used_ns));
            }
            _ => ask!(self, keep_sessions(id, 1)),
        }
        Ok(())
    }

    pub(super) async fn setup_codes(&mut self) -> Result<(), StoreError> {
        if self.chance.random() {
            ask!(self, keep_setup_codes(1));
            return Ok(());
        }
        ask!(self, keep_setup_codes(0));
        for text in ["1", "2"] {
            let code = SetupCode {
                hash: SecretHash::of(text),
                ends_ns: time(&mut self.chance),
            };
            ask!(self, add_setup_code(&code));
        }
        Ok(())
    }

    pub(super) async fn add_token(&mut self) -> Result<(), StoreError> {
        let (name, now) = (self.name(), self.now);
        let chance = &mut self.chance;
        let hash = secret(chance);
        let grant = if chance.random_bool(0.5) {
            Grant::of_token(Role::Robot, Some(robot(chance)))
        } else {
            Grant::of_token(Role::Viewer, None)
        };
        let token = TokenRecord {
            id: TokenId(0),
            name,
            grant: grant.unwrap(),
            hash,
            created_by: words(chance),
            span: TokenSpan {
                created_ns: WallTime(number(chance)),
                expires_ns: chance.random_bool(0.5).then(|| time(chance)),
                revoked_ns: None,
            },
            used_ns: None,
        };
        ask!(self, token_named(&token.name, now));
        // The value of a token is one of a kind; nothing in the transaction asks for it.
        let count = i64::from(ask!(self, count_tokens()));
        let mut taken = false;
        for id in 1..=count {
            let known = ask!(self, token(TokenId(id)));
            taken |= known.is_some_and(|known| known.hash == token.hash);
        }
        if !taken {
            ask!(self, add_token(&token));
        }
        Ok(())
    }

    pub(super) async fn revoke_token(&mut self) -> Result<(), StoreError> {
        let id = TokenId(self.chance.random_range(0..6));
        let now = self.now;
        ask!(self, save_token_revoked(id, now));
        ask!(self, token(id));
        Ok(())
    }
}
