//! The file from which a router knows its peers' passwords: `user:password` in each line.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs::{self, OpenOptions};
use std::io::{self, ErrorKind, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;

use fleetcal_link::password_file;
use fleetcal_operations::entropy;

use crate::command::CommandError;

/// Mode of a new file, which its owner alone reads and writes.
const OWNER_ALONE: u32 = 0o600;
/// Random bytes of a password, which is never typed.
const PASSWORD_BYTES: usize = 16;

/// Adds a password for each of these names that has none in the file, which is created if missing.
/// Returns the names that got one.
///
/// # Errors
/// The file cannot be read or written, or has another form.
pub fn complete<'a>(
    path: &Path,
    names: impl Iterator<Item = &'a str>,
) -> Result<Vec<&'a str>, CommandError> {
    let refused = |reason: String| CommandError::Passwords {
        path: path.to_owned(),
        reason,
    };
    let present = match fs::read_to_string(path) {
        Ok(text) => Some(text),
        Err(error) if error.kind() == ErrorKind::NotFound => None,
        Err(error) => return Err(refused(error.to_string())),
    };
    let text = present.as_deref().unwrap_or_default();
    let known: BTreeSet<&str> = password_file::users(text)
        .map_err(|error| refused(error.to_string()))?
        .into_iter()
        .collect();
    let added: Vec<&str> = names.filter(|name| !known.contains(name)).collect();
    if added.is_empty() {
        return Ok(added);
    }
    let mut lines = String::new();
    if !text.is_empty() && !text.ends_with('\n') {
        lines.push('\n');
    }
    for name in &added {
        let secret = entropy::secret()?;
        let password: Vec<u8> = secret.into_iter().take(PASSWORD_BYTES).collect();
        // Writing to a string does not fail.
        let _written = writeln!(lines, "{name}:{}", hex::encode(password));
    }
    append(path, &lines, present.is_none()).map_err(|error| refused(error.to_string()))?;
    Ok(added)
}

fn append(path: &Path, lines: &str, is_new: bool) -> io::Result<()> {
    let mut file = OpenOptions::new()
        .append(true)
        .create_new(is_new)
        .mode(OWNER_ALONE)
        .open(path)?;
    file.write_all(lines.as_bytes())?;
    file.sync_all()
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use tempfile::TempDir;

    use super::*;

    #[test]
    fn a_file_that_is_not_there_is_made_for_its_owner_alone() {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("passwords.txt");
        let added = complete(&path, ["a", "b"].into_iter()).unwrap();
        assert_eq!(added, ["a", "b"]);
        let mode = fs::metadata(&path).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, OWNER_ALONE);
        let text = fs::read_to_string(&path).unwrap();
        assert_eq!(password_file::users(&text).unwrap(), ["a", "b"]);
        let passwords: BTreeSet<&str> = text.lines().map(|line| &line[2..]).collect();
        assert_eq!(passwords.len(), 2);
        assert!(passwords.iter().all(|password| password.len() == 32));
    }

    #[test]
    fn who_has_a_password_keeps_it() {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("passwords.txt");
        fs::write(&path, "a:mine").unwrap();
        assert_eq!(complete(&path, ["a"].into_iter()).unwrap(), [""; 0]);
        assert_eq!(fs::read_to_string(&path).unwrap(), "a:mine");
        assert_eq!(complete(&path, ["a", "b"].into_iter()).unwrap(), ["b"]);
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.starts_with("a:mine\nb:"), "{text}");
    }

    #[test]
    fn a_file_that_is_none_is_named_and_left_as_it_is() {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("passwords.txt");
        fs::write(&path, "tugger_01 secret\n").unwrap();
        let reason = complete(&path, ["a"].into_iter()).unwrap_err().to_string();
        assert!(reason.contains("passwords.txt: line 1:"), "{reason}");
        assert!(!reason.contains("secret"), "{reason}");
        assert_eq!(fs::read_to_string(&path).unwrap(), "tugger_01 secret\n");
        let nowhere = folder.path().join("no/passwords.txt");
        let reason = complete(&nowhere, ["a"].into_iter())
            .unwrap_err()
            .to_string();
        assert!(
            reason.contains("no/passwords.txt: No such file"),
            "{reason}"
        );
    }
}
