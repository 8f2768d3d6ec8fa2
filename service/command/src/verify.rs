//! `fleetcal verify`: checks certificates of verified calibrations without the service.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use clap::Args;
use fleetcal_certificate::{page, text};
use fleetcal_proto::calibration::Envelope;
use fleetcal_proto::certificate::CertificateDocument;
use fleetcal_proto::signing::{EnvelopeRefused, OFFERED_BYTES_MAX, PublicKey, TrustedKeys};

use crate::CommandError;
use crate::output::print_text;
use crate::trust::ChangesArgument;

/// Arguments of `fleetcal verify`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The certificate, or a file with one in each line
    pub certificate: PathBuf,
    /// The service's public key, from `GET /api/v1/signing-key`; may be repeated
    #[arg(long, value_name = "PUBLICKEY", required = true)]
    pub key: Vec<PublicKey>,
    /// Changes of that key.
    #[command(flatten)]
    pub changes: ChangesArgument,
    /// Write the page of a single certificate, as the service shows it
    #[arg(long, value_name = "OUT.html")]
    pub html: Option<PathBuf>,
}

/// Checks every certificate of a file, and prints the content of each.
///
/// # Errors
/// The first certificate that is refused, with the check that failed; or a failure to read or
/// write.
pub fn run(arguments: &Arguments) -> Result<(), CommandError> {
    let trust = arguments.changes.trust(&arguments.key)?;
    let mut lines = Lines::open(&arguments.certificate)?;
    let mut last = None;
    while let Some((number, line)) = lines.read_next()? {
        let opened = opened(&line, &trust.trusted);
        let (envelope, document) = opened.map_err(|refused| CommandError::Certificate {
            path: arguments.certificate.clone(),
            line: number,
            refused: trust.in_words(&refused),
        })?;
        if number > 1 {
            print_text("\n")?;
        }
        print_text(&text(&document))?;
        print_text(&format!("\nGenuine: signed by key {}\n", envelope.key_id))?;
        last = Some((number, envelope, document));
    }
    let Some((certificates, envelope, document)) = last else {
        return Err(CommandError::NoCertificate(arguments.certificate.clone()));
    };
    match &arguments.html {
        None => Ok(()),
        Some(_) if certificates > 1 => Err(CommandError::OnePage { certificates }),
        Some(out) => {
            std::fs::write(out, page(&document, &envelope)).map_err(|source| CommandError::Write {
                path: out.clone(),
                source,
            })
        }
    }
}

fn opened(
    line: &[u8],
    trusted: &TrustedKeys,
) -> Result<(Envelope, CertificateDocument), EnvelopeRefused> {
    let envelope = Envelope::from_json(line)?;
    let document = envelope.open_as(trusted)?;
    Ok((envelope, document))
}

/// Lines of a file, none longer in memory than a certificate can be.
struct Lines {
    path: PathBuf,
    file: BufReader<File>,
    number: u64,
}

impl Lines {
    fn open(path: &Path) -> Result<Self, CommandError> {
        let file = File::open(path).map_err(|source| CommandError::Read {
            path: path.to_owned(),
            source,
        })?;
        Ok(Self {
            path: path.to_owned(),
            file: BufReader::new(file),
            number: 0,
        })
    }

    /// Reads the next line with its number, without its end. One that is too long is cut one byte
    /// beyond the limit, by which it is refused.
    fn read_next(&mut self) -> Result<Option<(u64, Vec<u8>)>, CommandError> {
        let mut line = Vec::new();
        let mut limited = (&mut self.file).take(OFFERED_BYTES_MAX as u64 + 1);
        let read = limited.read_until(b'\n', &mut line);
        read.map_err(|source| CommandError::Read {
            path: self.path.clone(),
            source,
        })?;
        if line.is_empty() {
            return Ok(None);
        }
        if line.last() == Some(&b'\n') {
            line.pop();
        }
        self.number += 1;
        Ok(Some((self.number, line)))
    }
}
