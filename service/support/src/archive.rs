//! Archive of files in the ZIP format, without compression: documents are short, and recordings are
//! packed already.

/// Version of the format that a reader needs: 2.0.
const VERSION: u16 = 20;
/// Flag of names in UTF-8.
const UTF_8: u16 = 1 << 11;
/// Date of every file, 1 January 1980: the archive's content alone tells times.
const DATE: u16 = 0x21;
/// Polynomial of the checksum, reversed.
const POLYNOMIAL: u32 = 0xedb8_8320;

/// Files that become one archive.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Archive {
    files: Vec<(String, Vec<u8>)>,
}

impl Archive {
    /// Adds a file. Its name may have folders, with `/`.
    pub fn add(&mut self, name: &str, content: Vec<u8>) {
        self.files.push((name.to_owned(), content));
    }

    /// Iterates over names and sizes, bytes.
    pub fn list(&self) -> impl Iterator<Item = (&str, usize)> {
        self.files
            .iter()
            .map(|(name, content)| (name.as_str(), content.len()))
    }

    /// Returns the archive. It has to be smaller than 4 GiB.
    pub fn into_zip(self) -> Vec<u8> {
        let mut zip = Vec::new();
        let mut directory = Vec::new();
        let count = self.files.len() as u16;
        for (name, content) in self.files {
            let begin = zip.len() as u32;
            let described = described(&name, &content);
            zip.extend_from_slice(b"PK\x03\x04");
            zip.extend_from_slice(&described);
            zip.extend_from_slice(name.as_bytes());
            zip.extend_from_slice(&content);

            directory.extend_from_slice(b"PK\x01\x02");
            directory.extend_from_slice(&VERSION.to_le_bytes());
            directory.extend_from_slice(&described);
            // Comment, disk, internal and external attributes.
            directory.extend_from_slice(&[0; 10]);
            directory.extend_from_slice(&begin.to_le_bytes());
            directory.extend_from_slice(name.as_bytes());
        }
        let begin = zip.len() as u32;
        zip.extend_from_slice(&directory);
        zip.extend_from_slice(b"PK\x05\x06\0\0\0\0");
        for number in [count, count] {
            zip.extend_from_slice(&number.to_le_bytes());
        }
        for number in [directory.len() as u32, begin] {
            zip.extend_from_slice(&number.to_le_bytes());
        }
        zip.extend_from_slice(&[0; 2]);
        zip
    }
}

/// Returns the part of a file's header that stands before it and in the directory.
fn described(name: &str, content: &[u8]) -> Vec<u8> {
    let mut header = Vec::with_capacity(26);
    // Version, flags, no compression, time and date.
    for number in [VERSION, UTF_8, 0, 0, DATE] {
        header.extend_from_slice(&number.to_le_bytes());
    }
    let size = content.len() as u32;
    for number in [checksum(content), size, size] {
        header.extend_from_slice(&number.to_le_bytes());
    }
    // Length of the name, and of further fields.
    for number in [name.len() as u16, 0] {
        header.extend_from_slice(&number.to_le_bytes());
    }
    header
}

/// Computes the CRC-32 of ZIP.
fn checksum(content: &[u8]) -> u32 {
    let mut table = [0_u32; 256];
    for (byte, entry) in (0_u32..).zip(&mut table) {
        *entry = (0..8).fold(byte, |value, _| {
            (value >> 1) ^ if value & 1 == 1 { POLYNOMIAL } else { 0 }
        });
    }
    !content.iter().fold(!0_u32, |value, &byte| {
        let entry = table.get(usize::from(value as u8 ^ byte)).copied();
        (value >> 8) ^ entry.unwrap_or_default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_archive_lists_its_files_and_has_their_checksums() {
        // The check value of CRC-32 in the catalogue of parametrised CRC algorithms.
        assert_eq!(checksum(b"123456789"), 0xcbf4_3926);
        assert_eq!(checksum(b""), 0);
        let mut archive = Archive::default();
        archive.add("a/robot.json", b"{}".to_vec());
        archive.add("a/log.txt", Vec::new());
        let listed: Vec<(&str, usize)> = archive.list().collect();
        assert_eq!(listed, [("a/robot.json", 2), ("a/log.txt", 0)]);
        let zip = archive.into_zip();
        // Header 30, name 12, content 2; header 30, name 9.
        let directory = 30 + 12 + 2 + 30 + 9;
        assert!(zip[directory..].starts_with(b"PK\x01\x02"));
        assert_eq!(zip.len(), directory + 46 + 12 + 46 + 9 + 22);
        assert_eq!(
            zip[zip.len() - 6..zip.len() - 2],
            (directory as u32).to_le_bytes()
        );
    }
}
