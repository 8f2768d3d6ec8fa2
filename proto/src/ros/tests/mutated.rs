use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

use super::*;

/// Number of payloads that are tried, over all types and both encodings.
const PAYLOADS: usize = 1_000_000;

/// Number of input bytes of a message's own elements, and their size in memory.
trait Footprint: RosMessage {
    /// Bytes that a message may take beyond its input: the headers of its strings.
    const FIXED_BYTES: usize = 0;

    /// Returns the bytes of memory behind its sequences and strings.
    fn allocated_bytes(&self) -> usize;
}

impl Footprint for LaserScan {
    fn allocated_bytes(&self) -> usize {
        4 * (self.ranges.len() + self.intensities.len()) + self.header.frame_id.capacity()
    }
}

impl Footprint for AckermannDriveStamped {
    fn allocated_bytes(&self) -> usize {
        self.header.frame_id.capacity()
    }
}

impl Footprint for JointState {
    const FIXED_BYTES: usize = crate::cdr::STRINGS_MAX * size_of::<String>();

    fn allocated_bytes(&self) -> usize {
        let names: usize = self.name.iter().map(String::capacity).sum();
        let numbers = self.position.len() + self.velocity.len() + self.effort.len();
        let headers = self.name.capacity() * size_of::<String>();
        8 * numbers + names + headers + self.header.frame_id.capacity()
    }
}

impl Footprint for Odometry {
    fn allocated_bytes(&self) -> usize {
        self.header.frame_id.capacity() + self.child_frame_id.capacity()
    }
}

impl Footprint for PointCloud2 {
    const FIXED_BYTES: usize = 64 * size_of::<PointField>();

    fn allocated_bytes(&self) -> usize {
        let names: usize = self.fields.iter().map(|field| field.name.capacity()).sum();
        let fields = self.fields.capacity() * size_of::<PointField>();
        self.data.len() + names + fields + self.header.frame_id.capacity()
    }
}

impl Footprint for Float64 {
    fn allocated_bytes(&self) -> usize {
        0
    }
}

/// Spoils a payload in one of the ways a broken or hostile sender would.
fn mutate(payload: &mut Vec<u8>, rng: &mut StdRng) {
    for _ in 0..rng.random_range(1..4) {
        let length = payload.len();
        let at = rng.random_range(0..length.max(1));
        match rng.random_range(0..6) {
            0 => payload.truncate(at),
            1 => payload.extend((0..rng.random_range(0..32)).map(|_| rng.random::<u8>())),
            2 if length >= 4 => {
                // Where lengths stand: a word, small or huge.
                let word = (at / 4 * 4).min(length - 4);
                let shift = rng.random_range(0..32);
                let value = rng.random::<u32>() >> shift;
                payload[word..word + 4].copy_from_slice(&value.to_le_bytes());
            }
            3 if length >= 8 => {
                let from = rng.random_range(0..length);
                payload.copy_within(from..(from + 4).min(length), at.min(length - 4));
            }
            4 if length > 0 => payload[at.min(length - 1)] ^= 1 << rng.random_range(0..8),
            _ if length > 0 => payload[at.min(length - 1)] = rng.random(),
            _ => payload.push(rng.random()),
        }
    }
}

/// Decodes one payload: the result is a message no larger than its input, or a sentence that names
/// a field. Returns whether it was refused.
fn decode_hostile<M: Footprint>(encoding: Encoding, payload: &[u8]) -> bool {
    match M::decode(encoding, payload) {
        Ok(message) => {
            // JSON says a beam in two characters where memory takes four bytes.
            let factor = if encoding == Encoding::Json { 4 } else { 1 };
            let allocated = message.allocated_bytes();
            let accepted = factor * payload.len() + M::FIXED_BYTES;
            assert!(allocated <= accepted, "{}: {allocated} bytes", M::TYPE);
            false
        }
        Err(DecodeError::Json { field, .. }) => {
            assert!(!field.is_empty(), "{} refused without a field", M::TYPE);
            true
        }
        Err(error) => {
            let sentence = error.to_string();
            assert!(sentence.starts_with(M::TYPE), "{sentence}");
            true
        }
    }
}

/// Mutates payloads of one message; returns the number of refusals.
fn attack<M: Footprint>(message: &M, payloads: usize, rng: &mut StdRng) -> usize {
    let sources = [
        (Encoding::Cdr, message.to_cdr()),
        (Encoding::Json, message.to_json().unwrap()),
    ];
    let mut payload = Vec::new();
    let mut refused = 0;
    for index in 0..payloads {
        // Mostly CDR, where lengths are claims.
        let (encoding, source) = &sources[usize::from(index % 4 == 0)];
        payload.clear();
        payload.extend_from_slice(source);
        mutate(&mut payload, rng);
        refused += usize::from(decode_hostile::<M>(*encoding, &payload));
    }
    refused
}

#[test]
fn a_million_mutated_payloads_do_no_harm() {
    let mut rng = StdRng::seed_from_u64(0x5eed);
    let each = PAYLOADS / 6;
    let refused = [
        attack(&scan(), each, &mut rng),
        attack(&drive(), each, &mut rng),
        attack(&joints(), each, &mut rng),
        attack(&odometry(), each, &mut rng),
        attack(&super::point_cloud2::cloud(), each, &mut rng),
        attack(&Float64 { data: 1.5 }, each, &mut rng),
    ];
    // A mutation that is never noticed, or always, would test nothing.
    for count in refused {
        assert!(
            count > each / 20 && count < each - each / 20,
            "{refused:?} of {each} each"
        );
    }
}

#[test]
fn random_bytes_do_no_harm() {
    let mut rng = StdRng::seed_from_u64(7);
    for _ in 0..50_000 {
        let length = rng.random_range(0..200);
        let mut payload: Vec<u8> = (0..length).map(|_| rng.random()).collect();
        if let [first, second, ..] = payload.as_mut_slice() {
            *first = 0;
            *second &= 1;
        }
        decode_hostile::<LaserScan>(Encoding::Cdr, &payload);
        decode_hostile::<AckermannDriveStamped>(Encoding::Cdr, &payload);
        decode_hostile::<JointState>(Encoding::Cdr, &payload);
        decode_hostile::<Odometry>(Encoding::Cdr, &payload);
    }
}
