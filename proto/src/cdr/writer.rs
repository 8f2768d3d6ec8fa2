//! Writes CDR in little endian.

/// Encapsulation header of little-endian `PLAIN_CDR`.
const HEADER: [u8; 4] = [0, 1, 0, 0];

/// Writer of the fields of one payload, in order.
#[derive(Debug, Clone)]
pub struct CdrWriter {
    bytes: Vec<u8>,
}

impl CdrWriter {
    /// Begins a payload; `body_bytes` is the number of bytes expected after its header.
    pub fn with_capacity(body_bytes: usize) -> Self {
        let mut bytes = Vec::with_capacity(HEADER.len() + body_bytes);
        bytes.extend_from_slice(&HEADER);
        Self { bytes }
    }

    /// Writes a `uint8`.
    pub fn u8(&mut self, value: u8) {
        self.bytes.push(value);
    }

    /// Writes a `boolean`.
    pub fn bool(&mut self, value: bool) {
        self.u8(u8::from(value));
    }

    /// Writes a sequence of `uint8` with its length.
    pub fn byte_sequence(&mut self, values: &[u8]) {
        self.length(values.len());
        self.bytes.extend_from_slice(values);
    }

    /// Writes the length of a sequence whose elements follow.
    pub fn sequence_length(&mut self, count: usize) {
        self.length(count);
    }

    /// Writes an `int32`.
    pub fn i32(&mut self, value: i32) {
        self.aligned(value.to_le_bytes());
    }

    /// Writes a `uint32`.
    pub fn u32(&mut self, value: u32) {
        self.aligned(value.to_le_bytes());
    }

    /// Writes a `float32`.
    pub fn f32(&mut self, value: f32) {
        self.aligned(value.to_le_bytes());
    }

    /// Writes a `float64`.
    pub fn f64(&mut self, value: f64) {
        self.aligned(value.to_le_bytes());
    }

    /// Writes an array of `float64` without a length.
    pub fn f64_array(&mut self, values: &[f64]) {
        for &value in values {
            self.f64(value);
        }
    }

    /// Writes a sequence of `float32` with its length.
    pub fn f32_sequence(&mut self, values: &[f32]) {
        self.length(values.len());
        for &value in values {
            self.f32(value);
        }
    }

    /// Writes a sequence of `float64` with its length.
    pub fn f64_sequence(&mut self, values: &[f64]) {
        self.length(values.len());
        self.f64_array(values);
    }

    /// Writes a string with its closing NUL.
    pub fn string(&mut self, text: &str) {
        self.length(text.len() + 1);
        self.bytes.extend_from_slice(text.as_bytes());
        self.bytes.push(0);
    }

    /// Writes a sequence of strings.
    pub fn string_sequence(&mut self, texts: &[String]) {
        self.length(texts.len());
        for text in texts {
            self.string(text);
        }
    }

    /// Returns the payload with its header.
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    // CDR has no longer sequences than 2^32 - 1; nobody holds one in memory here.
    fn length(&mut self, count: usize) {
        self.u32(count as u32);
    }

    fn aligned<const WIDTH: usize>(&mut self, value: [u8; WIDTH]) {
        let body_bytes = self.bytes.len() - HEADER.len();
        self.bytes
            .resize(HEADER.len() + body_bytes.next_multiple_of(WIDTH), 0);
        self.bytes.extend_from_slice(&value);
    }
}
