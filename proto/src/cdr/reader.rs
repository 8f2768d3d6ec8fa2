//! Reads CDR of either byte order without trusting any length in it.

use std::sync::Arc;

use super::{CdrError, Endianness, PADDING_BYTES_MAX, STRINGS_MAX};

/// Reader of the fields of one payload, in order. Memory is allocated only for bytes that are known
/// to be there, whatever length is claimed.
#[derive(Debug, Clone)]
pub struct CdrReader<'a> {
    body: &'a [u8],
    position: usize,
    endianness: Endianness,
}

impl<'a> CdrReader<'a> {
    /// Begins behind the encapsulation header of `payload`.
    ///
    /// # Errors
    /// When the header is not that of `PLAIN_CDR` in either byte order.
    pub fn new(payload: &'a [u8]) -> Result<Self, CdrError> {
        let (endianness, body) = match payload {
            [0, 0, _, _, body @ ..] => (Endianness::Big, body),
            [0, 1, _, _, body @ ..] => (Endianness::Little, body),
            _ => {
                let header = payload.iter().copied().take(4).collect();
                return Err(CdrError::Encapsulation { header });
            }
        };
        Ok(Self {
            body,
            position: 0,
            endianness,
        })
    }

    /// Returns the byte order of the payload.
    pub fn endianness(&self) -> Endianness {
        self.endianness
    }

    /// Returns the number of unread bytes.
    pub fn left(&self) -> usize {
        self.body.len().saturating_sub(self.position)
    }

    /// Reads a `uint8`.
    ///
    /// # Errors
    /// When the payload ends before.
    pub fn u8(&mut self, field: &'static str) -> Result<u8, CdrError> {
        let bytes = self.take(field, 1)?;
        Ok(bytes.first().copied().unwrap_or_default())
    }

    /// Reads a `boolean`.
    ///
    /// # Errors
    /// When the payload ends before, or it is neither 0 nor 1.
    pub fn bool(&mut self, field: &'static str) -> Result<bool, CdrError> {
        match self.u8(field)? {
            0 => Ok(false),
            1 => Ok(true),
            other => Err(CdrError::Value {
                field,
                value: other.to_string(),
                accepted: "0 or 1",
            }),
        }
    }

    /// Reads an `int32`.
    ///
    /// # Errors
    /// When the payload ends before.
    pub fn i32(&mut self, field: &'static str) -> Result<i32, CdrError> {
        self.word(field).map(|bytes| self.i32_from(bytes))
    }

    /// Reads a `uint32`.
    ///
    /// # Errors
    /// When the payload ends before.
    pub fn u32(&mut self, field: &'static str) -> Result<u32, CdrError> {
        self.word(field).map(|bytes| self.u32_from(bytes))
    }

    /// Reads a `float32`.
    ///
    /// # Errors
    /// When the payload ends before.
    pub fn f32(&mut self, field: &'static str) -> Result<f32, CdrError> {
        self.word(field).map(|bytes| self.f32_from(bytes))
    }

    /// Reads a `float64`.
    ///
    /// # Errors
    /// When the payload ends before.
    pub fn f64(&mut self, field: &'static str) -> Result<f64, CdrError> {
        let bytes = self
            .take_aligned::<8>(field, 1)?
            .first()
            .copied()
            .unwrap_or_default();
        Ok(self.f64_from(bytes))
    }

    /// Reads an array of `N` `float64`, whose length is not on the wire.
    ///
    /// # Errors
    /// When the payload ends before.
    pub fn f64_array<const N: usize>(&mut self, field: &'static str) -> Result<[f64; N], CdrError> {
        let words = self.take_aligned::<8>(field, N)?;
        let mut values = [0.0; N];
        for (value, &bytes) in values.iter_mut().zip(words) {
            *value = self.f64_from(bytes);
        }
        Ok(values)
    }

    /// Reads a sequence of `uint8` in one allocation of its exact size.
    ///
    /// # Errors
    /// When the sequence claims more than the payload holds.
    pub fn byte_sequence(&mut self, field: &'static str) -> Result<Arc<[u8]>, CdrError> {
        let count = self.length(field, 1)?;
        self.take(field, count).map(Arc::from)
    }

    /// Reads a sequence of at most `count_max` elements of at least `element_bytes` each, one by
    /// one with `read`.
    ///
    /// # Errors
    /// When the sequence claims more than is accepted or the payload holds, or `read` fails.
    pub fn sequence<T>(
        &mut self,
        field: &'static str,
        element_bytes: usize,
        count_max: usize,
        mut read: impl FnMut(&mut Self) -> Result<T, CdrError>,
    ) -> Result<Vec<T>, CdrError> {
        let count = self.length(field, element_bytes)?;
        if count > count_max {
            return Err(CdrError::Length {
                field,
                claimed: count as u32,
                accepted: count_max,
            });
        }
        (0..count).map(|_| read(self)).collect()
    }

    /// Reads a sequence of `float32` in one allocation of its exact size.
    ///
    /// # Errors
    /// When the sequence claims more than the payload holds.
    pub fn f32_sequence(&mut self, field: &'static str) -> Result<Arc<[f32]>, CdrError> {
        let count = self.length(field, 4)?;
        let words = self.take_aligned::<4>(field, count)?;
        Ok(match self.endianness {
            Endianness::Little => words
                .iter()
                .map(|&bytes| f32::from_le_bytes(bytes))
                .collect(),
            Endianness::Big => words
                .iter()
                .map(|&bytes| f32::from_be_bytes(bytes))
                .collect(),
        })
    }

    /// Reads a sequence of `float64`.
    ///
    /// # Errors
    /// When the sequence claims more than the payload holds.
    pub fn f64_sequence(&mut self, field: &'static str) -> Result<Vec<f64>, CdrError> {
        let count = self.length(field, 8)?;
        if count == 0 {
            // An empty sequence has no first element to align.
            return Ok(Vec::new());
        }
        let words = self.take_aligned::<8>(field, count)?;
        Ok(words.iter().map(|&bytes| self.f64_from(bytes)).collect())
    }

    /// Reads a string. It may lack its NUL only if its length is 0, as some senders write it.
    ///
    /// # Errors
    /// When it claims more than the payload holds, is not terminated, or not UTF-8.
    pub fn string(&mut self, field: &'static str) -> Result<String, CdrError> {
        let count = self.length(field, 1)?;
        let bytes = self.take(field, count)?;
        let text = match bytes {
            [] => bytes,
            [text @ .., 0] => text,
            _ => return Err(CdrError::StringNotTerminated { field }),
        };
        match std::str::from_utf8(text) {
            Ok(text) => Ok(text.to_owned()),
            Err(_) => Err(CdrError::StringNotUtf8 { field }),
        }
    }

    /// Reads a sequence of at most [`STRINGS_MAX`] strings.
    ///
    /// # Errors
    /// As for one string, and when there are too many.
    pub fn string_sequence(&mut self, field: &'static str) -> Result<Vec<String>, CdrError> {
        self.sequence(field, 4, STRINGS_MAX, |reader| reader.string(field))
    }

    /// Ends reading after `last_field`.
    ///
    /// # Errors
    /// When more follows than padding.
    pub fn finish(self, last_field: &'static str) -> Result<(), CdrError> {
        match self.left() {
            0..=PADDING_BYTES_MAX => Ok(()),
            extra => Err(CdrError::Trailing {
                field: last_field,
                extra,
            }),
        }
    }

    /// Reads a sequence's length and checks that as many elements can follow.
    fn length(&mut self, field: &'static str, element_bytes: usize) -> Result<usize, CdrError> {
        let claimed = self.u32(field)?;
        let accepted = self.left() / element_bytes;
        match usize::try_from(claimed) {
            Ok(count) if count <= accepted => Ok(count),
            _ => Err(CdrError::Length {
                field,
                claimed,
                accepted,
            }),
        }
    }

    fn word(&mut self, field: &'static str) -> Result<[u8; 4], CdrError> {
        self.take_aligned::<4>(field, 1)
            .map(|words| words.first().copied().unwrap_or_default())
    }

    /// Takes `count` words of `WIDTH` bytes, the first aligned to its width.
    fn take_aligned<const WIDTH: usize>(
        &mut self,
        field: &'static str,
        count: usize,
    ) -> Result<&'a [[u8; WIDTH]], CdrError> {
        let start = self.position.next_multiple_of(WIDTH);
        let padding = start - self.position;
        let bytes = self.take(field, padding.saturating_add(count.saturating_mul(WIDTH)))?;
        let (words, _) = bytes
            .get(padding..)
            .unwrap_or_default()
            .as_chunks::<WIDTH>();
        Ok(words)
    }

    fn take(&mut self, field: &'static str, needed: usize) -> Result<&'a [u8], CdrError> {
        let end = self.position.saturating_add(needed);
        let truncated = CdrError::Truncated {
            field,
            needed,
            left: self.left(),
        };
        let bytes = self.body.get(self.position..end).ok_or(truncated)?;
        self.position = end;
        Ok(bytes)
    }

    fn i32_from(&self, bytes: [u8; 4]) -> i32 {
        match self.endianness {
            Endianness::Little => i32::from_le_bytes(bytes),
            Endianness::Big => i32::from_be_bytes(bytes),
        }
    }

    fn u32_from(&self, bytes: [u8; 4]) -> u32 {
        match self.endianness {
            Endianness::Little => u32::from_le_bytes(bytes),
            Endianness::Big => u32::from_be_bytes(bytes),
        }
    }

    fn f32_from(&self, bytes: [u8; 4]) -> f32 {
        f32::from_bits(self.u32_from(bytes))
    }

    fn f64_from(&self, bytes: [u8; 8]) -> f64 {
        match self.endianness {
            Endianness::Little => f64::from_le_bytes(bytes),
            Endianness::Big => f64::from_be_bytes(bytes),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alignment_counts_from_behind_the_header() {
        let payload = [
            0, 0, 0, 0, 0, 0, 0, 7, 9, 9, 9, 9, 0x3f, 0xf0, 0, 0, 0, 0, 0, 0,
        ];
        let mut reader = CdrReader::new(&payload).unwrap();
        assert_eq!(reader.endianness(), Endianness::Big);
        assert_eq!(reader.u32("a").unwrap(), 7);
        assert_eq!(reader.f64("b").unwrap().to_bits(), 1.0_f64.to_bits());
        reader.finish("b").unwrap();
    }

    #[test]
    fn a_hostile_length_is_refused_by_name() {
        let payload = [0, 1, 0, 0, 0xff, 0xff, 0xff, 0xff, 1, 2, 3, 4];
        let claims = |accepted| CdrError::Length {
            field: "ranges",
            claimed: u32::MAX,
            accepted,
        };
        let reader = || CdrReader::new(&payload).unwrap();
        assert_eq!(reader().f32_sequence("ranges"), Err(claims(1)));
        assert_eq!(reader().f64_sequence("ranges"), Err(claims(0)));
        assert_eq!(reader().string("ranges"), Err(claims(4)));
        assert_eq!(reader().string_sequence("ranges"), Err(claims(1)));
    }

    #[test]
    fn other_encapsulations_are_refused() {
        for header in [
            &[][..],
            &[0, 1, 0],
            &[0, 3, 0, 0],
            &[0, 7, 0, 0, 1],
            b"{\"he",
        ] {
            let sentence = CdrReader::new(header).unwrap_err().to_string();
            assert!(
                sentence.starts_with("encapsulation header: got ["),
                "{sentence}"
            );
        }
    }

    #[test]
    fn strings_must_be_terminated_utf8() {
        let read = |bytes: &[u8]| CdrReader::new(bytes).unwrap().string("frame_id");
        assert_eq!(read(&[0, 1, 0, 0, 0, 0, 0, 0]), Ok(String::new()));
        assert_eq!(read(&[0, 1, 0, 0, 2, 0, 0, 0, b'a', 0]), Ok("a".to_owned()));
        assert_eq!(
            read(&[0, 1, 0, 0, 1, 0, 0, 0, b'a']),
            Err(CdrError::StringNotTerminated { field: "frame_id" })
        );
        assert_eq!(
            read(&[0, 1, 0, 0, 2, 0, 0, 0, 0xff, 0]),
            Err(CdrError::StringNotUtf8 { field: "frame_id" })
        );
    }
}
