//! Cookie of a session.

use axum::http::{HeaderMap, HeaderValue, header};
use fleetcal_domain::access::SessionValue;
use fleetcal_domain::limits;

/// Name and protection of the session's cookie.
#[derive(Debug, Clone, Copy)]
pub struct CookiePolicy {
    https: bool,
}

impl CookiePolicy {
    /// Makes the policy of a service that is reached over HTTPS or not.
    pub const fn new(https: bool) -> Self {
        Self { https }
    }

    /// Name of the cookie. Over HTTPS it binds the cookie to this host and to encrypted
    /// connections.
    const fn name(self) -> &'static str {
        if self.https {
            "__Host-fleetcal_session"
        } else {
            "fleetcal_session"
        }
    }

    /// Header `Set-Cookie` of a new session.
    pub fn set(self, session: &SessionValue) -> HeaderValue {
        self.header(session.reveal(), limits::SESSION_MAX.as_secs())
    }

    /// Header `Set-Cookie` that removes the cookie.
    pub fn clear(self) -> HeaderValue {
        self.header("", 0)
    }

    fn header(self, value: &str, seconds: u64) -> HeaderValue {
        let secure = if self.https { "; Secure" } else { "" };
        let name = self.name();
        let text =
            format!("{name}={value}; Path=/; Max-Age={seconds}; HttpOnly; SameSite=Strict{secure}");
        HeaderValue::from_str(&text).unwrap_or(HeaderValue::from_static(""))
    }

    /// Session in a request's cookie, if it has one.
    pub fn session(self, headers: &HeaderMap) -> Option<Result<SessionValue, Garbage>> {
        let shown = headers
            .get_all(header::COOKIE)
            .iter()
            .filter_map(|value| value.to_str().ok())
            .flat_map(|value| value.split(';'))
            .filter_map(|pair| pair.trim().split_once('='))
            .find(|(name, _)| *name == self.name());
        shown.map(|(_, value)| SessionValue::parse(value).ok_or(Garbage))
    }
}

/// Malformed cookie.
#[derive(Debug, Clone, Copy)]
pub struct Garbage;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cookie_comes_back_as_it_was_set() {
        for https in [false, true] {
            let policy = CookiePolicy::new(https);
            let session = SessionValue::new(&[9; 32]);
            let set = policy.set(&session).to_str().unwrap().to_owned();
            assert!(set.contains("; Path=/; Max-Age=604800; HttpOnly; SameSite=Strict"));
            assert_eq!(
                (set.starts_with("__Host-"), set.ends_with("; Secure")),
                (https, https)
            );
            let (pair, _) = set.split_once(';').unwrap();
            let shown = format!("theme=dark; {pair}");
            let headers =
                HeaderMap::from_iter([(header::COOKIE, HeaderValue::from_str(&shown).unwrap())]);
            let found = policy.session(&headers).unwrap().unwrap();
            assert_eq!(found.hash(), session.hash());
            assert!(CookiePolicy::new(!https).session(&headers).is_none());
        }
    }

    #[test]
    fn garbage_is_told_from_nothing() {
        let policy = CookiePolicy::new(false);
        assert!(policy.session(&HeaderMap::new()).is_none());
        let garbage = HeaderValue::from_static("fleetcal_session=%00");
        let headers = HeaderMap::from_iter([(header::COOKIE, garbage)]);
        assert!(policy.session(&headers).unwrap().is_err());
        assert!(policy.clear().to_str().unwrap().contains("Max-Age=0"));
    }
}
