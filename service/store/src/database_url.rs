//! URL of a PostgreSQL: `postgres://user@host1,host2:5433/database?sslmode=verify-full`.

use std::fmt;
use std::net::IpAddr;
use std::path::PathBuf;
use std::str::FromStr;

use serde::Deserialize;
use thiserror::Error;
use url::Url;

/// Default port of PostgreSQL.
const PORT: u16 = 5_432;

/// Most hosts of a URL.
pub const HOSTS_MAX: usize = 16;

/// Address of a database, and its TLS. It never holds a password.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub struct PostgresUrl {
    /// Role that signs in.
    pub user: String,
    /// Database on the server.
    pub database: String,
    /// Possible servers; the first writable one is used.
    pub servers: Vec<Server>,
    /// TLS required of the connection.
    pub tls: TlsMode,
    /// Trusted certificates, PEM; the system's unless given.
    pub root_certificate: Option<PathBuf>,
    /// Certificate of this client, PEM.
    pub client_certificate: Option<PathBuf>,
    /// Key of that certificate, PEM.
    pub client_key: Option<PathBuf>,
}

/// Address of one server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Server {
    /// Host name or address, and a port.
    Tcp {
        /// Host of the server.
        host: String,
        /// Port of the server.
        port: u16,
    },
    /// Unix socket in a folder.
    Socket {
        /// Folder of the socket.
        folder: PathBuf,
        /// Port, which is a part of the socket's name.
        port: u16,
    },
}

impl Server {
    /// True if the connection stays on this machine.
    fn is_local(&self) -> bool {
        match self {
            Self::Socket { .. } => true,
            Self::Tcp { host, .. } => {
                let bare = host.trim_start_matches('[').trim_end_matches(']');
                host == "localhost"
                    || bare
                        .parse()
                        .is_ok_and(|address: IpAddr| address.is_loopback())
            }
        }
    }
}

impl fmt::Display for Server {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tcp { host, port } => write!(f, "{host}:{port}"),
            Self::Socket { folder, .. } => write!(f, "{}", folder.display()),
        }
    }
}

/// Required TLS, as libpq names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TlsMode {
    /// No TLS.
    Disable,
    /// TLS if the server offers it.
    Prefer,
    /// TLS with any certificate.
    Require,
    /// TLS with a trusted certificate, of any host.
    VerifyCa,
    /// TLS with a trusted certificate of this host.
    VerifyFull,
}

impl TlsMode {
    fn parse(text: &str) -> Option<Self> {
        Some(match text {
            "disable" => Self::Disable,
            "prefer" => Self::Prefer,
            "require" => Self::Require,
            "verify-ca" => Self::VerifyCa,
            "verify-full" => Self::VerifyFull,
            _ => return None,
        })
    }
}

/// Reason for which a text is no URL of a database.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum DatabaseUrlRefused {
    /// Text that is no URL of PostgreSQL.
    #[error(
        "got {got:?}, expected postgres://USER@HOST[:PORT][,HOST…]/DATABASE or \
         postgres://USER@/DATABASE?host=/FOLDER"
    )]
    Form {
        /// Given text, without any possible password.
        got: String,
    },
    /// URL with a password.
    #[error(
        "got a URL with a password, expected one without; put the password into a file \
         and name it with --database-password-file or PGPASSFILE"
    )]
    Password,
    /// Unknown parameter.
    #[error("got the parameter {got:?}, expected sslmode, sslrootcert, sslcert, sslkey or host")]
    Parameter {
        /// Name of the parameter.
        got: String,
    },
    /// Unknown mode of TLS.
    #[error("got sslmode={got:?}, expected disable, prefer, require, verify-ca or verify-full")]
    Tls {
        /// Given mode.
        got: String,
    },
    /// Too many hosts.
    #[error("got {got} hosts, expected {HOSTS_MAX} at most")]
    Hosts {
        /// Number of hosts.
        got: usize,
    },
}

impl TryFrom<String> for PostgresUrl {
    type Error = DatabaseUrlRefused;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        text.parse()
    }
}

impl FromStr for PostgresUrl {
    type Err = DatabaseUrlRefused;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (user_info, hosts, rest) = parts(text)?;
        let count = hosts.split(',').count();
        if count > HOSTS_MAX {
            return Err(DatabaseUrlRefused::Hosts { got: count });
        }
        let mut found: Option<Self> = None;
        for host in hosts.split(',') {
            // One host at a time is a URL as anyone reads it, and that of a socket has none.
            let on_socket = host.is_empty() || host.starts_with(':');
            let here = if on_socket { "localhost" } else { "" };
            let url = Url::parse(&format!("postgres://{user_info}@{here}{host}/{rest}"));
            let one = Self::of_one(&url.map_err(|_| form(text))?, on_socket, text)?;
            match &mut found {
                Some(all) => all.servers.extend(one.servers),
                None => found = Some(one),
            }
        }
        let mut found = found.ok_or_else(|| form(text))?;
        let named = tls_named(text)?;
        let local = found.servers.iter().all(Server::is_local);
        let usual = if local {
            TlsMode::Prefer
        } else {
            TlsMode::VerifyFull
        };
        found.tls = named.unwrap_or(usual);
        Ok(found)
    }
}

/// User, hosts and rest of a URL.
fn parts(text: &str) -> Result<(&str, &str, &str), DatabaseUrlRefused> {
    let scheme = ["postgres://", "postgresql://"];
    let after = scheme.iter().find_map(|scheme| text.strip_prefix(scheme));
    let (authority, rest) = after
        .and_then(|after| after.split_once('/'))
        .ok_or_else(|| form(text))?;
    let (user_info, hosts) = authority.rsplit_once('@').ok_or_else(|| form(text))?;
    if user_info.contains(':') {
        return Err(DatabaseUrlRefused::Password);
    }
    if user_info.is_empty() {
        return Err(form(text));
    }
    Ok((user_info, hosts, rest))
}

/// Refusal of a text, which repeats its scheme alone: it may hold a password.
fn form(text: &str) -> DatabaseUrlRefused {
    let got = match text.split_once("://") {
        Some((scheme, _)) => format!("{scheme}://…"),
        None => text.to_owned(),
    };
    DatabaseUrlRefused::Form { got }
}

impl PostgresUrl {
    /// Parses a URL with one host; `on_socket` if that host is a placeholder.
    fn of_one(url: &Url, on_socket: bool, text: &str) -> Result<Self, DatabaseUrlRefused> {
        let database = decoded(url.path().trim_start_matches('/'));
        if database.is_empty() || database.contains('/') {
            return Err(form(text));
        }
        let port = url.port().unwrap_or(PORT);
        let mut server = url
            .host_str()
            .filter(|_| !on_socket)
            .map(|host| Server::Tcp {
                host: host.to_owned(),
                port,
            });
        let mut one = Self {
            user: decoded(url.username()),
            database,
            servers: Vec::new(),
            tls: TlsMode::VerifyFull,
            root_certificate: None,
            client_certificate: None,
            client_key: None,
        };
        for (name, value) in url.query_pairs() {
            match name.as_ref() {
                "sslmode" => {}
                "sslrootcert" => one.root_certificate = Some(PathBuf::from(&*value)),
                "sslcert" => one.client_certificate = Some(PathBuf::from(&*value)),
                "sslkey" => one.client_key = Some(PathBuf::from(&*value)),
                "host" if value.starts_with('/') && server.is_none() => {
                    server = Some(Server::Socket {
                        folder: PathBuf::from(&*value),
                        port,
                    });
                }
                "password" => return Err(DatabaseUrlRefused::Password),
                _ => {
                    return Err(DatabaseUrlRefused::Parameter {
                        got: name.into_owned(),
                    });
                }
            }
        }
        one.servers.push(server.ok_or_else(|| form(text))?);
        Ok(one)
    }
}

/// Mode of TLS in a URL.
fn tls_named(text: &str) -> Result<Option<TlsMode>, DatabaseUrlRefused> {
    let query = text.split_once('?').map_or("", |(_, query)| query);
    let mut pairs = url::form_urlencoded::parse(query.as_bytes());
    let Some((_, mode)) = pairs.find(|(name, _)| name == "sslmode") else {
        return Ok(None);
    };
    let refused = || DatabaseUrlRefused::Tls {
        got: mode.clone().into_owned(),
    };
    TlsMode::parse(&mode).map(Some).ok_or_else(refused)
}

/// Decodes a part of a URL.
fn decoded(part: &str) -> String {
    let form = part.replace('+', "%2B");
    let mut pairs = url::form_urlencoded::parse(form.as_bytes());
    pairs
        .next()
        .map(|(text, _)| text.into_owned())
        .unwrap_or_default()
}

impl fmt::Display for PostgresUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let [Server::Socket { folder, .. }] = self.servers.as_slice() {
            let (user, database) = (&self.user, &self.database);
            return write!(f, "postgres://{user}@/{database}?host={}", folder.display());
        }
        let servers: Vec<String> = self.servers.iter().map(ToString::to_string).collect();
        write!(
            f,
            "postgres://{}@{}/{}",
            self.user,
            servers.join(","),
            self.database
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> PostgresUrl {
        text.parse().unwrap()
    }

    fn refused(text: &str) -> String {
        text.parse::<PostgresUrl>().unwrap_err().to_string()
    }

    #[test]
    fn a_url_names_hosts_in_order() {
        let url = parsed("postgres://fleet%20cal@db1,db2:5433,[fd00::1]/fleet?sslrootcert=/ca.pem");
        assert_eq!(url.user, "fleet cal");
        assert_eq!(url.database, "fleet");
        let servers: Vec<String> = url.servers.iter().map(ToString::to_string).collect();
        assert_eq!(servers, ["db1:5432", "db2:5433", "[fd00::1]:5432"]);
        assert_eq!(url.tls, TlsMode::VerifyFull);
        assert_eq!(url.root_certificate, Some(PathBuf::from("/ca.pem")));
    }

    #[test]
    fn tls_is_verified_unless_the_machine_is_this_one_or_a_weaker_mode_is_named() {
        assert_eq!(parsed("postgres://f@127.0.0.1/f").tls, TlsMode::Prefer);
        assert_eq!(parsed("postgres://f@localhost:1/f").tls, TlsMode::Prefer);
        assert_eq!(parsed("postgres://f@[::1]/f").tls, TlsMode::Prefer);
        assert_eq!(
            parsed("postgres://f@/f?host=/run/postgresql").tls,
            TlsMode::Prefer
        );
        assert_eq!(
            parsed("postgres://f@localhost,db/f").tls,
            TlsMode::VerifyFull
        );
        assert_eq!(
            parsed("postgres://f@db/f?sslmode=require").tls,
            TlsMode::Require
        );
        let said = refused("postgres://f@db/f?sslmode=allow");
        assert!(
            said.contains("got sslmode=\"allow\", expected disable"),
            "{said}"
        );
    }

    #[test]
    fn a_url_is_shown_as_it_can_be_given() {
        for text in [
            "postgres://f@db1:5432,db2:5433/fleet",
            "postgres://f@/fleet?host=/run/postgresql",
        ] {
            assert_eq!(parsed(text).to_string(), text);
        }
    }

    #[test]
    fn a_password_is_refused_and_not_repeated() {
        for text in [
            "postgres://f:secret@db/f",
            "postgres://f@db/f?password=secret",
            "postgres://f:se@cret@db/f",
        ] {
            let said = refused(text);
            assert!(said.contains("got a URL with a password"), "{said}");
            assert!(!said.contains("cret"), "{said}");
        }
        assert!(!refused("postgres://f:secret@db").contains("secret"));
    }

    #[test]
    fn what_is_no_url_is_refused_with_the_form_that_is_expected() {
        for text in [
            "",
            "db",
            "mysql://f@db/f",
            "postgres://db/f",
            "postgres://f@db",
            "postgres://f@/f",
        ] {
            let said = refused(text);
            assert!(
                said.contains("expected postgres://USER@HOST"),
                "{text}: {said}"
            );
        }
        assert!(refused("postgres://f@db/f?ssl=1").contains("got the parameter \"ssl\""));
        let many = vec!["h"; HOSTS_MAX + 1].join(",");
        assert!(refused(&format!("postgres://f@{many}/f")).contains("got 17 hosts"));
    }
}
