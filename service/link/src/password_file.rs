//! The file of users and passwords of a Zenoh router, read as Zenoh does, but with words for people.

use std::fs;
use std::path::{Path, PathBuf};

use thiserror::Error;

/// Reasons why a router cannot authenticate its peers by a file.
#[derive(Debug, Error)]
pub enum PasswordFileRefused {
    /// The file cannot be read.
    #[error("{}: {reason}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The system's error.
        reason: std::io::Error,
    },
    /// The file has another form.
    #[error("{}: {refused}", path.display())]
    Form {
        /// The file.
        path: PathBuf,
        /// The line.
        refused: LineRefused,
    },
}

/// A line that is not `user:password`. Its content is secret.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("line {line}: got {found}, expected user:password")]
pub struct LineRefused {
    line: usize,
    found: &'static str,
}

/// Checks a file of passwords.
///
/// # Errors
/// The file cannot be read, a line has another form, or there are no lines.
pub fn check(path: &Path) -> Result<(), PasswordFileRefused> {
    let text = fs::read_to_string(path).map_err(|reason| PasswordFileRefused::Unreadable {
        path: path.to_owned(),
        reason,
    })?;
    let form = |refused| PasswordFileRefused::Form {
        path: path.to_owned(),
        refused,
    };
    // Zenoh would take everybody.
    match users(&text).map_err(form)?.as_slice() {
        [] => Err(form(LineRefused {
            line: 1,
            found: "no user",
        })),
        _ => Ok(()),
    }
}

/// Returns the users of a file's text, in its order.
///
/// # Errors
/// A line is neither empty nor `user:password`.
pub fn users(text: &str) -> Result<Vec<&str>, LineRefused> {
    let mut users = Vec::new();
    for (text, line) in text.lines().zip(1..) {
        if text.trim().is_empty() {
            continue;
        }
        let refused = |found| LineRefused { line, found };
        let (user, password) = text.split_once(':').ok_or(refused("no colon"))?;
        match (user.trim(), password.trim()) {
            ("", _) => return Err(refused("no user")),
            (_, "") => return Err(refused("no password")),
            (user, _) => users.push(user),
        }
    }
    Ok(users)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_user_and_password() {
        assert_eq!(users("a:1\n\n b : 2:3 \n"), Ok(vec!["a", "b"]));
        for (text, found) in [("a", "no colon"), (":1", "no user"), ("a:", "no password")] {
            let refused = LineRefused { line: 2, found };
            assert_eq!(users(&format!("x:y\n{text}\n")), Err(refused));
        }
    }
}
