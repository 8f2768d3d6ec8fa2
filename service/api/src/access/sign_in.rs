//! Sign-in by name and password, with a limit of attempts.

use std::time::Duration;

use axum::http::StatusCode;
use fleetcal_domain::access::PasswordHash;
use fleetcal_domain::limits;
use fleetcal_http::{PeerAddress, Whose};
use fleetcal_store::UserRecord;
use fleetcal_store::cluster::Try;

use super::caller::unauthorised;
use crate::ApiState;
use crate::problem::Problem;

pub(super) fn too_many(wait: Duration) -> Problem {
    let seconds = u32::try_from(wait.as_secs())
        .unwrap_or(u32::MAX)
        .saturating_add(1);
    let detail = format!("too many tries; try again in {seconds} s");
    Problem::new(StatusCode::TOO_MANY_REQUESTS, "too_many_tries", detail).retry_after(seconds)
}

/// Counts an attempt to sign in under a name: at this process, and in a cluster over all instances,
/// whose balancer may send each attempt to another one.
async fn count(api: &ApiState, peer: PeerAddress, name: &str) -> Result<Whose, Problem> {
    let limits = &api.access.limits;
    let now = api.clock.elapsed();
    limits.count_address(peer, now).map_err(too_many)?;
    let registry = api.store.registry();
    if let Some(registry) = &registry
        && !limits.knows(peer, name)
        && registry.has_signed_in(&peer.with_name(name)).await?
    {
        limits.note_known(peer, name);
    }
    let whose = limits.count_name(peer, name, now).map_err(too_many)?;
    if let Some(registry) = registry {
        let tries = tries(peer, name, whose);
        let wait = registry.count_tries(&tries).await?;
        wait.map_or(Ok(()), |wait| Err(too_many(wait)))?;
    }
    Ok(whose)
}

/// Counters of one attempt, with the limits of [`fleetcal_http::SignInLimits`].
fn tries(peer: PeerAddress, name: &str, whose: Whose) -> Vec<Try> {
    let one = |key, every, burst| Try { key, every, burst };
    let mut tries = vec![
        one(
            peer.key(),
            limits::SIGN_IN_ADDRESS_EVERY,
            limits::SIGN_IN_ADDRESS_BURST,
        ),
        one(
            peer.with_name(name),
            limits::SIGN_IN_NAME_EVERY,
            limits::SIGN_IN_NAME_BURST,
        ),
    ];
    if whose == Whose::Stranger {
        tries.push(one(
            format!("\n{name}"),
            limits::SIGN_IN_EVERYWHERE_EVERY,
            limits::SIGN_IN_EVERYWHERE_BURST,
        ));
    }
    tries
}

/// User of this name and password. An unknown name takes as long as a wrong password, and has the
/// same answer.
pub(super) async fn verified(
    api: &ApiState,
    peer: PeerAddress,
    name: &str,
    password: String,
) -> Result<UserRecord, Problem> {
    let key: String = name
        .chars()
        .take(limits::ACCOUNT_NAME_CHARS_MAX)
        .collect::<String>()
        .to_lowercase();
    let whose = count(api, peer, &key).await?;
    let user = api.store.user_named(name).await?;
    let hash = user
        .as_ref()
        .map_or_else(PasswordHash::of_nobody, |user| user.password.clone());
    let right = api.access.passwords.verify(whose, hash, password).await?;
    let Some(user) = user.filter(|user| right && !user.disabled) else {
        tracing::warn!(peer = %peer.key(), "a sign-in was refused");
        return Err(unauthorised("sign_in_refused", "name or password is wrong"));
    };
    api.access.limits.note_right(peer, &key);
    if let Some(registry) = api.store.registry() {
        let pair = peer.with_name(&key);
        let tries = [pair.clone(), format!("\n{key}")];
        // Who was let in is let in: what is lost is that the other instances know the address.
        if let Err(error) = registry.signed_in(&pair, &tries).await {
            tracing::warn!(%error, "the sign-in was not recorded for the other instances");
        }
    }
    Ok(user)
}
