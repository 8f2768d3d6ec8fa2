//! Users, sessions and tokens with their audit, on the real database.

use fleetcal_contract::TestDatabase;
use fleetcal_domain::access::{
    AccountName, AccountRefused, Actor, Authentication, Grant, HttpRequest, PasswordHash, Role,
    SecretHash,
};
use fleetcal_model::{UserId, Version, WallTime};
use fleetcal_store::{AuditFilter, AuditRow, Credential, Expected, IdempotencyKey, StoreError};

use super::*;
use crate::testing::{NOW_NS, clock, open, robot};

fn actor() -> Actor {
    Actor {
        name: "root".to_owned(),
        authentication: Authentication::Session,
        role: Some(Role::Admin),
        request: Some(HttpRequest {
            id: Some("r-1".to_owned()),
            address: Some("192.0.2.7".to_owned()),
        }),
    }
}

fn name(text: &str) -> AccountName {
    AccountName::parse(text).unwrap()
}

fn new_user(text: &str, role: Role) -> UserChange {
    UserChange::Create {
        name: name(text),
        grant: Grant::of_person(role).unwrap(),
        password: PasswordHash::stored("hash".to_owned()),
        key: None,
    }
}

fn new_token(text: &str, role: Role) -> TokenChange {
    TokenChange::Create {
        name: name(text),
        grant: Grant::of_token(role, (role == Role::Robot).then(|| robot("a"))).unwrap(),
        hash: SecretHash::of(text),
        expires_ns: None,
        key: None,
    }
}

/// Every audit row, oldest first.
async fn audit_rows(store: &Store) -> Vec<AuditRow> {
    let filter = AuditFilter {
        limit: 1_000,
        ..AuditFilter::default()
    };
    let mut rows = store.audit(&filter).await.unwrap();
    rows.reverse();
    rows
}

/// Texts `action subject subject_id actor` of every audit row, oldest first.
async fn audit(store: &Store) -> Vec<String> {
    let rows = audit_rows(store).await;
    let line = |row: &AuditRow| {
        let (action, subject) = (&row.action, &row.subject);
        format!("{action} {subject} {} {}", row.subject_id, row.actor)
    };
    rows.iter().map(line).collect()
}

/// Number of a user: PostgreSQL does not assign a number again after its transaction was undone.
async fn id_of(store: &Store, name: &str) -> UserId {
    store.user_named(name).await.unwrap().unwrap().id
}

/// Sign-in of a user whose password was right at `version`.
fn sign_in(id: UserId, version: Version) -> UserChange {
    UserChange::SignIn {
        id,
        version,
        session: SecretHash::of("cookie"),
    }
}

fn edit(id: UserId, version: Version, edit: UserEdit) -> UserChange {
    UserChange::Edit {
        id,
        expected: Expected::Version(version),
        edit,
        keep: None,
    }
}

fn password() -> UserEdit {
    UserEdit {
        password: Some(PasswordHash::stored("other".to_owned())),
        ..UserEdit::default()
    }
}

#[tokio::test]
async fn every_change_leaves_its_audit_row_without_secrets() {
    let database = TestDatabase::new().await;
    let store = open(&database, &clock()).await;
    let user = async |change| change_user(&store, actor(), change).await.unwrap();
    let session = SecretHash::of("cookie");
    user(new_user("ann", Role::Admin)).await;
    let ann = id_of(&store, "ann").await;
    user(sign_in(ann, Version(1))).await;
    let found = store.session_of(session).await.unwrap().unwrap();
    assert_eq!((found.user.id, found.span.used_ns), (ann, WallTime(NOW_NS)));
    user(UserChange::SignOut { session }).await;
    assert_eq!(store.session_of(session).await.unwrap(), None);
    user(edit(ann, Version(1), password())).await;
    let token = change_token(&store, actor(), new_token("ci", Role::Viewer));
    let id = token.await.unwrap().record.id;
    for _ in 0..2 {
        let revoked = change_token(&store, actor(), TokenChange::Revoke { id });
        revoked.await.unwrap();
    }
    let wanted = [
        format!("user.create user {ann} root"),
        format!("session.sign_in user {ann} root"),
        format!("session.sign_out user {ann} root"),
        format!("user.password user {ann} root"),
        format!("token.create token {id} root"),
        format!("token.revoke token {id} root"),
    ];
    assert_eq!(audit(&store).await, wanted);
    let secrets = audit_rows(&store).await.iter().any(|row| {
        let said = format!("{:?}{:?}", row.before, row.after);
        said.contains("hash") || said.contains("other")
    });
    assert!(!secrets);
}

#[tokio::test]
async fn a_refused_change_leaves_no_audit_row() {
    let database = TestDatabase::new().await;
    let store = open(&database, &clock()).await;
    let user = async |change| change_user(&store, actor(), change).await;
    let session = SecretHash::of("cookie");
    user(new_user("ann", Role::Admin)).await.unwrap();
    let ann = id_of(&store, "ann").await;
    user(edit(ann, Version(1), password())).await.unwrap();
    let viewer = UserEdit {
        grant: Some(Grant::of_person(Role::Viewer).unwrap()),
        ..UserEdit::default()
    };
    let changes = [
        new_user("ANN", Role::Viewer),
        sign_in(ann, Version(1)),
        UserChange::SignOut { session },
        edit(ann, Version(1), viewer.clone()),
        edit(ann, Version(2), viewer),
        UserChange::Remove {
            id: ann,
            expected: Expected::Any,
        },
        UserChange::SetUp {
            name: name("eve"),
            password: PasswordHash::stored("hash".to_owned()),
            session,
        },
    ];
    for change in changes {
        let refused = user(change).await;
        assert!(
            matches!(refused, Err(StoreError::Account(_))),
            "{refused:?}"
        );
    }
    let wanted = [
        format!("user.create user {ann} root"),
        format!("user.password user {ann} root"),
    ];
    assert_eq!(audit(&store).await, wanted);
}

#[tokio::test]
async fn of_many_who_remove_the_last_administrators_one_is_refused() {
    let database = TestDatabase::new().await;
    let store = open(&database, &clock()).await;
    for admin in ["a", "b", "c"] {
        let made = change_user(&store, actor(), new_user(admin, Role::Admin)).await;
        made.unwrap();
    }
    let mut admins = Vec::new();
    for admin in ["a", "b", "c"] {
        admins.push(id_of(&store, admin).await);
    }
    let removals = admins.into_iter().map(|id| {
        let expected = Expected::Version(Version(1));
        change_user(&store, actor(), UserChange::Remove { id, expected })
    });
    let done = futures::future::join_all(removals).await;
    let refused: Vec<_> = done.into_iter().filter_map(Result::err).collect();
    assert!(
        matches!(
            refused.as_slice(),
            [StoreError::Account(AccountRefused::LastAdmin)]
        ),
        "{refused:?}"
    );
}

#[tokio::test]
async fn a_repeated_request_makes_one_token() {
    let database = TestDatabase::new().await;
    let store = open(&database, &clock()).await;
    let make = async |text: &str, sha: u8| {
        let TokenChange::Create {
            name,
            grant,
            hash,
            expires_ns,
            ..
        } = new_token(text, Role::Robot)
        else {
            panic!("a new token")
        };
        let key = Some(IdempotencyKey {
            key: "k".to_owned(),
            request_sha256: [sha; 32],
        });
        let change = TokenChange::Create {
            name,
            grant,
            hash,
            expires_ns,
            key,
        };
        change_token(&store, actor(), change).await
    };
    let first = make("ci", 1).await.unwrap();
    let second = make("ci", 1).await.unwrap();
    assert_eq!((first.repeated, second.repeated), (false, true));
    assert_eq!(first.record, second.record);
    assert!(matches!(make("ci", 2).await, Err(StoreError::KeyReused)));
    assert_eq!(first.record.grant.robot(), Some(&robot("a")));
}

#[tokio::test]
async fn uses_are_noted_and_outlive_a_restart() {
    let database = TestDatabase::new().await;
    let clock = clock();
    let store = open(&database, &clock).await;
    let made = change_token(&store, actor(), new_token("ci", Role::Viewer)).await;
    let hash = made.unwrap().record.hash;
    clock.advance(std::time::Duration::from_secs(5));
    store.note_use(Credential::Token(hash));
    store.close().await.unwrap();
    drop(store);
    let store = open(&database, &clock).await;
    let token = store.token_of(hash).await.unwrap().unwrap();
    assert_eq!(token.used_ns, Some(WallTime(NOW_NS + 5_000_000_000)));
    assert_eq!(store.token_of(SecretHash::of("x")).await.unwrap(), None);
}
