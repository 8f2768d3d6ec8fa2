//! PGM images: netpbm's grey maps, plain (P2) and binary (P5).
//!
//! A magic number, then width, height and the largest shade as words of ASCII, with comments from
//! `#` to the end of a line between them; then the shades from the top row down, as words again or
//! as one byte each, two (the higher first) when the largest shade is above 255.

use fleetcal_estimator::occupancy_grid::GRID_CELLS_MAX;

/// An image with shades from 0, black, to 255, white.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pgm {
    /// Pixels of a row.
    pub width: usize,
    /// Shades from the top row down.
    pub shades: Vec<u8>,
}

/// Reason for refusing an image: the field, its value and the accepted values.
#[derive(Debug, PartialEq, Eq)]
pub struct PgmRefused {
    /// Name of the field.
    pub field: &'static str,
    /// Its value.
    pub value: String,
    /// Accepted values.
    pub accepted: &'static str,
}

fn refused(field: &'static str, value: impl Into<String>, accepted: &'static str) -> PgmRefused {
    PgmRefused {
        field,
        value: value.into(),
        accepted,
    }
}

/// Longest file that is read, bytes: as many pixels as there may be, each with up to five digits
/// and a space.
pub const PGM_BYTES_MAX: u64 = 6 * GRID_CELLS_MAX as u64;

/// Largest sample a PGM may have.
const LARGEST_MAX: u32 = 65_535;

impl Pgm {
    /// Parses an image. A binary file may continue with further images after its pixels, which are
    /// ignored.
    ///
    /// # Errors
    /// Names the invalid field, its value and the accepted values.
    pub fn parse(bytes: &[u8]) -> Result<Self, PgmRefused> {
        let is_binary = match bytes.get(..2) {
            Some(b"P2") => false,
            Some(b"P5") => true,
            other => {
                let magic = String::from_utf8_lossy(other.unwrap_or(bytes)).into_owned();
                let accepted = "a PGM image, which begins with P2 or P5";
                return Err(refused("image", format!("{magic:?}"), accepted));
            }
        };
        let mut words = Words { bytes, at: 2 };
        let width = words.number("image width", "1 or more pixels", 1, u32::MAX)? as usize;
        let height = words.number("image height", "1 or more pixels", 1, u32::MAX)? as usize;
        let accepted = "a largest shade from 1 to 65535";
        let largest = words.number("image maxval", accepted, 1, LARGEST_MAX)?;
        let pixels = width.checked_mul(height).filter(|&n| n <= GRID_CELLS_MAX);
        let Some(pixels) = pixels else {
            let value = format!("{width} by {height} pixels");
            return Err(refused("image", value, "at most 67108864 pixels"));
        };
        let shades = if is_binary {
            binary(words.behind_one_space(), pixels, largest)?
        } else {
            plain(&mut words, pixels, largest)?
        };
        Ok(Self { width, shades })
    }
}

/// Scales a sample to a shade of at most 255.
fn shade(sample: u32, largest: u32) -> u8 {
    ((sample.min(largest) * 255 + largest / 2) / largest) as u8
}

fn binary(bytes: &[u8], pixels: usize, largest: u32) -> Result<Vec<u8>, PgmRefused> {
    let width = if largest > 255 { 2 } else { 1 };
    let Some(samples) = bytes.get(..pixels * width) else {
        let value = format!("{} bytes of pixels", bytes.len());
        return Err(refused("image", value, "as many as width times height"));
    };
    let sample = |bytes: &[u8]| {
        bytes
            .iter()
            .fold(0, |sum, &byte| sum << 8 | u32::from(byte))
    };
    let samples = samples.chunks_exact(width).map(sample);
    let mut shades = Vec::with_capacity(pixels);
    for sample in samples {
        if sample > largest {
            return Err(too_large(sample));
        }
        shades.push(shade(sample, largest));
    }
    Ok(shades)
}

fn too_large(sample: u32) -> PgmRefused {
    refused(
        "image pixel",
        sample.to_string(),
        "a shade from 0 to the image's maxval",
    )
}

fn plain(words: &mut Words<'_>, pixels: usize, largest: u32) -> Result<Vec<u8>, PgmRefused> {
    // A pixel takes two bytes at least: nothing is allocated that the file cannot fill.
    let mut shades = Vec::with_capacity(pixels.min(words.bytes.len() / 2 + 1));
    for _ in 0..pixels {
        let accepted = "a shade from 0 to the image's maxval";
        let sample = words.number("image pixel", accepted, 0, largest)?;
        shades.push(shade(sample, largest));
    }
    Ok(shades)
}

/// Words of ASCII between spaces and comments.
struct Words<'a> {
    bytes: &'a [u8],
    at: usize,
}

/// Longest word that an error shows.
const SHOWN_MAX: usize = 12;

impl<'a> Words<'a> {
    fn next(&mut self) -> &'a [u8] {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        let mut start = 0;
        while let Some(byte) = rest.get(start) {
            match byte {
                b'#' => {
                    let comment = rest.get(start..).unwrap_or_default();
                    let is_end = |byte: &u8| matches!(byte, b'\n' | b'\r');
                    start += comment.iter().position(is_end).unwrap_or(comment.len());
                }
                byte if byte.is_ascii_whitespace() => start += 1,
                _ => break,
            }
        }
        let rest = rest.get(start..).unwrap_or_default();
        let is_end = |byte: &u8| byte.is_ascii_whitespace() || *byte == b'#';
        let length = rest.iter().position(is_end).unwrap_or(rest.len());
        self.at += start + length;
        rest.get(..length).unwrap_or_default()
    }

    fn number(
        &mut self,
        field: &'static str,
        accepted: &'static str,
        least: u32,
        most: u32,
    ) -> Result<u32, PgmRefused> {
        let word = self.next();
        std::str::from_utf8(word)
            .ok()
            .and_then(|word| word.parse().ok())
            .filter(|number| (least..=most).contains(number))
            .ok_or_else(|| {
                let shown = word.get(..SHOWN_MAX).unwrap_or(word);
                let value = match shown {
                    [] => "nothing".to_owned(),
                    shown => String::from_utf8_lossy(shown).escape_debug().to_string(),
                };
                refused(field, value, accepted)
            })
    }

    /// Returns the bytes after the single space that ends the header.
    fn behind_one_space(&self) -> &'a [u8] {
        self.bytes.get(self.at + 1..).unwrap_or_default()
    }
}
