//! `fleetcal audit`: shows whether rows of the audit were changed or removed after they were written.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use fleetcal_command::output::print_text;
use fleetcal_command::trust::{ChangesArgument, Trust};
use fleetcal_command::{EXIT_DATA, EXIT_FOUND};
use fleetcal_domain::limits;
use fleetcal_domain::timestamp;
use fleetcal_model::AuditId;
use fleetcal_proto::audit_head::AuditHeadDocument;
use fleetcal_proto::calibration::Envelope;
use fleetcal_proto::signing::{ENVELOPE_BYTES_MAX, PublicKey};
use fleetcal_store::{AuditBroken, AuditRow};
use jiff::Timestamp;
use serde::Deserialize;
use thiserror::Error;

use crate::command::CommandError;
use crate::database::Place;

/// Rows that are read at once.
const ROWS_AT_ONCE: u32 = 1_000;

/// Arguments of `fleetcal audit`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The action.
    #[command(subcommand)]
    pub action: Action,
}

/// Actions on the audit.
#[derive(Debug, Subcommand)]
pub enum Action {
    /// Checks every row of the records, also while the service runs
    Verify(Verify),
    /// Checks a downloaded NDJSON file, which holds every row between its first and its last one
    VerifyFile(VerifyFile),
}

/// Arguments of `fleetcal audit verify`.
#[derive(Debug, Args)]
pub struct Verify {
    /// Place of the records
    #[command(flatten)]
    pub place: Place,
    /// Heads that were kept elsewhere
    #[command(flatten)]
    pub heads: Heads,
}

/// Arguments of `fleetcal audit verify-file`.
#[derive(Debug, Args)]
pub struct VerifyFile {
    /// The file, from `GET /api/v1/audit?format=ndjson`
    pub file: PathBuf,
    /// Heads that were kept elsewhere
    #[command(flatten)]
    pub heads: Heads,
}

/// Flags that name signed heads.
#[derive(Debug, Args)]
pub struct Heads {
    /// A head that was kept elsewhere, from `GET /api/v1/audit/head`; may be repeated
    #[arg(long, value_name = "FILE", requires = "key")]
    head: Vec<PathBuf>,
    /// The service's public key, from `GET /api/v1/signing-key`; may be repeated
    #[arg(long, value_name = "PUBLICKEY")]
    key: Vec<PublicKey>,
    /// Changes of that key.
    #[command(flatten)]
    changes: ChangesArgument,
}

/// Finding in an audit, or in what it is checked against.
#[derive(Debug, Error)]
pub enum AuditFault {
    /// A row was changed or removed.
    #[error(transparent)]
    Broken(#[from] AuditBroken),
    /// A row differs from its head.
    #[error("row {row} of the audit is not the one that {} was signed for", head.display())]
    Differs {
        /// Number of the row.
        row: AuditId,
        /// File of the head.
        head: PathBuf,
    },
    /// The row of a head is missing.
    #[error("row {row} of the audit, which {} was signed for, is missing", head.display())]
    HeadMissing {
        /// Number of the row.
        row: AuditId,
        /// File of the head.
        head: PathBuf,
    },
    /// A head is not genuine.
    #[error("--head: {}: refused: {refused}", head.display())]
    Head {
        /// File of the head.
        head: PathBuf,
        /// The check that failed.
        refused: String,
    },
    /// A line of a file is no row.
    #[error("{}: line {line}: got {reason}, expected a row of the audit", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Line of the file.
        line: u64,
        /// Fault of the line.
        reason: String,
    },
}

impl AuditFault {
    /// Returns the exit status of the program.
    pub fn exit_status(&self) -> u8 {
        match self {
            Self::Line { .. } => EXIT_DATA,
            Self::Broken(_)
            | Self::Differs { .. }
            | Self::HeadMissing { .. }
            | Self::Head { .. } => EXIT_FOUND,
        }
    }
}

/// Head that was kept elsewhere, with its file.
type Kept = (PathBuf, AuditHeadDocument);

impl Heads {
    /// Reads the heads.
    fn read(&self) -> Result<Vec<Kept>, CommandError> {
        if self.head.is_empty() {
            return Ok(Vec::new());
        }
        let trust = self.changes.trust(&self.key)?;
        self.head.iter().map(|path| head(path, &trust)).collect()
    }
}

fn head(path: &Path, trust: &Trust) -> Result<Kept, CommandError> {
    let mut text = Vec::new();
    let most = ENVELOPE_BYTES_MAX as u64 + 1;
    let read = File::open(path).and_then(|file| file.take(most).read_to_end(&mut text));
    read.map_err(|source| fleetcal_command::CommandError::Read {
        path: path.to_owned(),
        source,
    })?;
    let opened = Envelope::from_json(&text).and_then(|envelope| envelope.open_as(&trust.trusted));
    let document = opened.map_err(|refused| AuditFault::Head {
        head: path.to_owned(),
        refused: trust.in_words(&refused),
    })?;
    Ok((path.to_owned(), document))
}

/// Progress of a check, oldest row first or newest first.
#[derive(Debug, Default)]
struct Check {
    heads: Vec<Kept>,
    rows: u64,
    /// Highest row without a link.
    unlinked: Option<AuditId>,
    lowest: Option<AuditId>,
    highest: Option<AuditId>,
}

impl Check {
    fn of(heads: Vec<Kept>) -> Self {
        Self {
            heads,
            ..Self::default()
        }
    }

    /// Takes a row into account, and compares it with its heads.
    fn count(&mut self, row: &AuditRow) -> Result<(), AuditFault> {
        self.rows += 1;
        if row.link.is_none() {
            self.unlinked = self.unlinked.max(Some(row.id));
        }
        self.lowest = Some(self.lowest.map_or(row.id, |lowest| lowest.min(row.id)));
        self.highest = Some(self.highest.map_or(row.id, |highest| highest.max(row.id)));
        let differs =
            |(_, head): &&Kept| head.row == row.id && Some(&head.link) != row.link.as_ref();
        match self.heads.iter().find(differs) {
            None => Ok(()),
            Some((path, _)) => Err(AuditFault::Differs {
                row: row.id,
                head: path.clone(),
            }),
        }
    }

    /// Ends the check: every head has to have its row.
    fn end(&self) -> Result<String, AuditFault> {
        let (Some(lowest), Some(highest)) = (self.lowest, self.highest) else {
            return match self.heads.first() {
                None => Ok("The audit has no row.\n".to_owned()),
                Some((path, head)) => Err(missing(path, head)),
            };
        };
        let within = lowest..=highest;
        if let Some((path, head)) = self
            .heads
            .iter()
            .find(|(_, head)| !within.contains(&head.row))
        {
            return Err(missing(path, head));
        }
        let unlinked = self.unlinked.map_or_else(String::new, |row| {
            format!("No link covers what is older than row {row}, which has none.\n")
        });
        let first = match lowest {
            AuditId(1) => String::new(),
            _ => format!("Row {lowest} is not checked: the row before it is not here.\n"),
        };
        let heads = self
            .heads
            .iter()
            .map(|(path, head)| format!("Row {} is the one of {}.\n", head.row, path.display()));
        let heads: String = heads.collect();
        let rows = self.rows;
        Ok(format!(
            "{rows} rows, {lowest} to {highest}: none is missing, none with a link was changed.\n\
             {unlinked}{first}{heads}"
        ))
    }
}

fn missing(path: &Path, head: &AuditHeadDocument) -> AuditFault {
    AuditFault::HeadMissing {
        row: head.row,
        head: path.to_owned(),
    }
}

/// Runs the action.
///
/// # Errors
/// The first row that was changed or is missing, or a failure to read.
pub async fn run(arguments: &Arguments) -> Result<(), CommandError> {
    let said = match &arguments.action {
        Action::Verify(verify) => verified(verify).await?,
        Action::VerifyFile(verify) => verified_file(verify)?,
    };
    Ok(print_text(&said)?)
}

async fn verified(arguments: &Verify) -> Result<String, CommandError> {
    let mut check = Check::of(arguments.heads.read()?);
    let database = arguments.place.administration().await?;
    let mut before: Option<AuditRow> = None;
    loop {
        let after = before.as_ref().map_or(AuditId(0), |row| row.id);
        let rows = database.audit_after(after, ROWS_AT_ONCE).await?;
        if rows.is_empty() {
            break;
        }
        for row in rows {
            row.check_after(before.as_ref())
                .map_err(AuditFault::Broken)?;
            check.count(&row)?;
            before = Some(row);
        }
    }
    database.close().await?;
    Ok(check.end()?)
}

/// Row as a file has it.
#[derive(Debug, Deserialize)]
struct FileRow {
    id: AuditId,
    time: Timestamp,
    actor: String,
    authentication: String,
    role: Option<String>,
    request: Option<String>,
    address: Option<String>,
    action: String,
    subject: String,
    subject_id: String,
    robot: Option<String>,
    reason: Option<String>,
    before: Option<serde_json::Value>,
    after: Option<serde_json::Value>,
    link: Option<String>,
}

impl FileRow {
    /// Returns the row; `None` if its time is beyond the times of rows.
    fn row(self) -> Option<AuditRow> {
        Some(AuditRow {
            id: self.id,
            at_ns: timestamp::wall(self.time)?,
            actor: self.actor,
            authentication: self.authentication,
            role: self.role,
            request: self.request,
            address: self.address,
            action: self.action,
            subject: self.subject,
            subject_id: self.subject_id,
            robot: self.robot,
            before: self.before,
            after: self.after,
            reason: self.reason,
            link: self.link,
        })
    }
}

/// Checks a file, whose rows are newest first. Its oldest row may have been changed: the row before
/// it is not there.
fn verified_file(arguments: &VerifyFile) -> Result<String, CommandError> {
    let mut check = Check::of(arguments.heads.read()?);
    let path = &arguments.file;
    let unreadable = |source| fleetcal_command::CommandError::Read {
        path: path.clone(),
        source,
    };
    let mut file = BufReader::new(File::open(path).map_err(unreadable)?);
    let (mut number, mut later): (u64, Option<AuditRow>) = (0, None);
    loop {
        let mut line = String::new();
        let mut limited = (&mut file).take(limits::AUDIT_ROW_BYTES_MAX);
        if limited.read_line(&mut line).map_err(unreadable)? == 0 {
            break;
        }
        number += 1;
        let row = parsed(&line).map_err(|reason| AuditFault::Line {
            path: path.clone(),
            line: number,
            reason,
        })?;
        check.count(&row)?;
        if let Some(later) = &later {
            later.check_after(Some(&row)).map_err(AuditFault::Broken)?;
        }
        later = Some(row);
    }
    if let Some(first) = later.filter(|row| row.id == AuditId(1)) {
        first.check_after(None).map_err(AuditFault::Broken)?;
    }
    Ok(check.end()?)
}

fn parsed(line: &str) -> Result<AuditRow, String> {
    let row: FileRow = serde_json::from_str(line).map_err(|error| error.to_string())?;
    let time = row.time;
    row.row().ok_or_else(|| format!("time {time}"))
}
