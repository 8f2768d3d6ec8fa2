//! Archive of files in the ZIP format, without compression: documents are short, and recordings are
//! packed already.

use std::fs::File;
use std::io::{self, Read, Seek, Write};

/// Version of the format that a reader needs: 2.0.
const VERSION: u16 = 20;
/// Flag of names in UTF-8.
const UTF_8: u16 = 1 << 11;
/// Date of every file, 1 January 1980: the archive's content alone tells times.
const DATE: u16 = 0x21;
/// Polynomial of the checksum, reversed.
const POLYNOMIAL: u32 = 0xedb8_8320;
/// Checksum's part for each byte.
const TABLE: [u32; 256] = table();
/// Bytes of a file that are in memory at once.
const BLOCK_BYTES: usize = 64 * 1024;

/// Content of a file.
#[derive(Debug)]
enum Content {
    Bytes(Vec<u8>),
    /// File on disk, with its size, bytes.
    OnDisk(File, u64),
}

impl Content {
    fn bytes(&self) -> u64 {
        match self {
            Self::Bytes(bytes) => bytes.len() as u64,
            Self::OnDisk(_, bytes) => *bytes,
        }
    }

    /// Passes the content on in blocks.
    fn each_block(&mut self, mut take: impl FnMut(&[u8]) -> io::Result<()>) -> io::Result<()> {
        let (file, bytes) = match self {
            Self::Bytes(bytes) => return take(bytes),
            Self::OnDisk(file, bytes) => (file, *bytes),
        };
        file.rewind()?;
        let mut block = vec![0; BLOCK_BYTES];
        let mut left = bytes;
        while left > 0 {
            let length = left.min(BLOCK_BYTES as u64);
            let part = block.get_mut(..length as usize).unwrap_or_default();
            file.read_exact(part)?;
            take(part)?;
            left -= length;
        }
        Ok(())
    }
}

/// Files that become one archive.
#[derive(Debug, Default)]
pub struct Archive {
    files: Vec<(String, Content)>,
}

impl Archive {
    /// Adds a file. Its name may have folders, with `/`.
    pub fn add(&mut self, name: &str, content: Vec<u8>) {
        self.files.push((name.to_owned(), Content::Bytes(content)));
    }

    /// Adds a file on disk of this size, bytes, which is read when the archive is written.
    pub fn add_on_disk(&mut self, name: &str, file: File, bytes: u64) {
        let content = Content::OnDisk(file, bytes);
        self.files.push((name.to_owned(), content));
    }

    /// Iterates over names and sizes, bytes.
    pub fn list(&self) -> impl Iterator<Item = (&str, u64)> {
        self.files
            .iter()
            .map(|(name, content)| (name.as_str(), content.bytes()))
    }

    /// Writes the archive. Of files on disk a block is in memory at a time.
    ///
    /// # Errors
    /// The writer fails, a file cannot be read or is shorter than its size, or the archive exceeds
    /// the format: 65,535 files, 4 GiB, names of 64 KiB.
    pub fn write(self, to: &mut impl Write) -> io::Result<()> {
        let count = u16::try_from(self.files.len()).map_err(too_large)?;
        let mut directory = Vec::new();
        let mut written = 0_u64;
        for (name, mut content) in self.files {
            let begin = u32::try_from(written).map_err(too_large)?;
            let described = described(&name, &mut content)?;
            to.write_all(b"PK\x03\x04")?;
            to.write_all(&described)?;
            to.write_all(name.as_bytes())?;
            content.each_block(|block| to.write_all(block))?;
            written += 4 + described.len() as u64 + name.len() as u64 + content.bytes();

            directory.extend_from_slice(b"PK\x01\x02");
            directory.extend_from_slice(&VERSION.to_le_bytes());
            directory.extend_from_slice(&described);
            // Comment, disk, internal and external attributes.
            directory.extend_from_slice(&[0; 10]);
            directory.extend_from_slice(&begin.to_le_bytes());
            directory.extend_from_slice(name.as_bytes());
        }
        let begin = u32::try_from(written).map_err(too_large)?;
        let length = u32::try_from(directory.len()).map_err(too_large)?;
        directory.extend_from_slice(b"PK\x05\x06\0\0\0\0");
        for number in [count, count] {
            directory.extend_from_slice(&number.to_le_bytes());
        }
        for number in [length, begin] {
            directory.extend_from_slice(&number.to_le_bytes());
        }
        directory.extend_from_slice(&[0; 2]);
        to.write_all(&directory)
    }
}

fn too_large(_: std::num::TryFromIntError) -> io::Error {
    io::Error::new(
        io::ErrorKind::FileTooLarge,
        "the archive exceeds the ZIP format",
    )
}

/// Returns the part of a file's header that stands before it and in the directory.
fn described(name: &str, content: &mut Content) -> io::Result<Vec<u8>> {
    let size = u32::try_from(content.bytes()).map_err(too_large)?;
    let name_bytes = u16::try_from(name.len()).map_err(too_large)?;
    let mut header = Vec::with_capacity(26);
    // Version, flags, no compression, time and date.
    for number in [VERSION, UTF_8, 0, 0, DATE] {
        header.extend_from_slice(&number.to_le_bytes());
    }
    for number in [checksum(content)?, size, size] {
        header.extend_from_slice(&number.to_le_bytes());
    }
    // Length of the name, and of further fields.
    for number in [name_bytes, 0] {
        header.extend_from_slice(&number.to_le_bytes());
    }
    Ok(header)
}

const fn table() -> [u32; 256] {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut value = byte as u32;
        let mut bit = 0;
        while bit < 8 {
            value = (value >> 1) ^ if value & 1 == 1 { POLYNOMIAL } else { 0 };
            bit += 1;
        }
        table[byte] = value;
        byte += 1;
    }
    table
}

/// Computes the CRC-32 of ZIP.
fn checksum(content: &mut Content) -> io::Result<u32> {
    let mut value = !0_u32;
    content.each_block(|block| {
        value = block.iter().fold(value, |value, &byte| {
            let entry = TABLE.get(usize::from(value as u8 ^ byte)).copied();
            (value >> 8) ^ entry.unwrap_or_default()
        });
        Ok(())
    })?;
    Ok(!value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn zip_of(archive: Archive) -> io::Result<Vec<u8>> {
        let mut zip = Vec::new();
        archive.write(&mut zip)?;
        Ok(zip)
    }

    /// Archive of one file on disk of this claimed size.
    fn on_disk(path: &str, bytes: u64) -> Archive {
        let mut archive = Archive::default();
        archive.add_on_disk("a.mcap", File::open(path).unwrap(), bytes);
        archive
    }

    #[test]
    fn an_archive_lists_its_files_and_has_their_checksums() {
        // The check value of CRC-32 in the catalogue of parametrised CRC algorithms.
        let of = |bytes: &[u8]| checksum(&mut Content::Bytes(bytes.to_vec())).unwrap();
        assert_eq!(of(b"123456789"), 0xcbf4_3926);
        assert_eq!(of(b""), 0);
        let mut archive = Archive::default();
        archive.add("a/robot.json", b"{}".to_vec());
        archive.add("a/log.txt", Vec::new());
        let listed: Vec<(&str, u64)> = archive.list().collect();
        assert_eq!(listed, [("a/robot.json", 2), ("a/log.txt", 0)]);
        let zip = zip_of(archive).unwrap();
        // Header 30, name 12, content 2; header 30, name 9.
        let directory = 30 + 12 + 2 + 30 + 9;
        assert!(zip[directory..].starts_with(b"PK\x01\x02"));
        assert_eq!(zip.len(), directory + 46 + 12 + 46 + 9 + 22);
        assert_eq!(
            zip[zip.len() - 6..zip.len() - 2],
            (directory as u32).to_le_bytes()
        );
    }

    #[test]
    fn a_file_on_disk_is_written_as_its_bytes_are() {
        let bytes = BLOCK_BYTES * 2 + 7;
        let archive = on_disk("/dev/zero", bytes as u64);
        assert_eq!(archive.list().next(), Some(("a.mcap", bytes as u64)));
        let mut of_bytes = Archive::default();
        of_bytes.add("a.mcap", vec![0; bytes]);
        assert!(zip_of(archive).unwrap() == zip_of(of_bytes).unwrap());
        let short = zip_of(on_disk("/dev/null", 1)).unwrap_err();
        assert_eq!(short.kind(), io::ErrorKind::UnexpectedEof);
    }

    #[test]
    fn what_exceeds_the_format_is_refused() {
        let large = on_disk("/dev/null", u64::from(u32::MAX) + 1);
        let mut many = Archive::default();
        for _ in 0..=u16::MAX {
            many.add("a", Vec::new());
        }
        let mut long = Archive::default();
        long.add(&"a".repeat(usize::from(u16::MAX) + 1), Vec::new());
        for archive in [large, many, long] {
            let refused = zip_of(archive).unwrap_err();
            assert_eq!(refused.kind(), io::ErrorKind::FileTooLarge);
        }
    }
}
