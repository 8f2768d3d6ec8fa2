//! Damage to an input, drawn by a seed: the same seed damages the same bytes in the same way.

/// Longest damaged input, bytes.
const INPUT_BYTES_MAX: usize = 1 << 20;
/// Most steps of damage to one input.
const STEPS_MAX: u64 = 6;
/// Numbers at which lengths, counts and stamps go wrong.
const NUMBERS: [u64; 12] = [
    0,
    1,
    7,
    0x7f,
    0xff,
    0x7fff,
    0xffff,
    0x7fff_ffff,
    0xffff_ffff,
    1 << 40,
    i64::MAX as u64,
    u64::MAX,
];
/// Words that readers of texts treat as special.
const WORDS: [&str; 24] = [
    "\"",
    "\\",
    "{",
    "}",
    "[",
    "]",
    ":",
    ",",
    "\n",
    "\0",
    "*",
    "**",
    "/",
    "@",
    "..",
    "null",
    "-1",
    "1e999",
    "NaN",
    "\\ud800",
    "\u{feff}",
    "=",
    "#",
    "[[robot]]",
];

/// Source of numbers (`SplitMix64`).
#[derive(Debug, Clone)]
pub struct Draw(u64);

impl Draw {
    /// Begins with a seed.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Returns the next number.
    pub fn number(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// Returns a number below `end`; 0 if there is none.
    pub fn below(&mut self, end: usize) -> usize {
        let end = end as u64;
        (self.number() % end.max(1)) as usize
    }

    fn one<'a, T>(&mut self, all: &'a [T]) -> Option<&'a T> {
        all.get(self.below(all.len()))
    }
}

/// Damages one of `seeds`, perhaps with a part of another.
pub fn damaged(seeds: &[Vec<u8>], draw: &mut Draw) -> Vec<u8> {
    let mut input = draw.one(seeds).cloned().unwrap_or_default();
    for _ in 0..=draw.number() % STEPS_MAX {
        step(&mut input, seeds, draw);
    }
    input.truncate(INPUT_BYTES_MAX);
    input
}

fn step(input: &mut Vec<u8>, seeds: &[Vec<u8>], draw: &mut Draw) {
    let at = draw.below(input.len());
    match draw.number() % 10 {
        0 => {
            let bit = draw.below(8);
            if let Some(byte) = input.get_mut(at) {
                *byte ^= 1 << bit;
            }
        }
        1 => {
            let value = draw.number() as u8;
            if let Some(byte) = input.get_mut(at) {
                *byte = value;
            }
        }
        2 => write_number(input, at, draw),
        3 => input.truncate(at),
        4 => {
            let end = (at + 1 + draw.below(64)).min(input.len());
            input.drain(at.min(end)..end);
        }
        5 => {
            let end = (at + 1 + draw.below(256)).min(input.len());
            let part = input
                .get(at..end)
                .unwrap_or_default()
                .repeat(1 + draw.below(4));
            insert(input, at, &part);
        }
        6 => {
            let word = draw.one(&WORDS).copied().unwrap_or_default();
            insert(input, at, word.as_bytes());
        }
        7 => {
            let other = draw.one(seeds).cloned().unwrap_or_default();
            let from = draw.below(other.len());
            let to = (from + draw.below(512)).min(other.len());
            insert(input, at, other.get(from..to).unwrap_or_default());
        }
        8 => {
            let other = draw.one(seeds).cloned().unwrap_or_default();
            let from = draw.below(other.len());
            input.truncate(at);
            input.extend_from_slice(other.get(from..).unwrap_or_default());
        }
        _ => {
            let to = draw.below(input.len());
            if at < input.len() {
                input.swap(at, to);
            }
        }
    }
}

/// Overwrites a number of 1, 2, 4 or 8 bytes in either byte order.
fn write_number(input: &mut [u8], at: usize, draw: &mut Draw) {
    let number = draw.one(&NUMBERS).copied().unwrap_or_default();
    let width = 1 << draw.below(4);
    let (little, big) = (number.to_le_bytes(), number.to_be_bytes());
    let bytes = if draw.number().is_multiple_of(2) {
        &little[..width]
    } else {
        &big[8 - width..]
    };
    // Fields of most formats are aligned.
    let at = at - at % width;
    if let Some(place) = input.get_mut(at..at + width) {
        place.copy_from_slice(bytes);
    }
}

fn insert(input: &mut Vec<u8>, at: usize, part: &[u8]) {
    let at = at.min(input.len());
    input.splice(at..at, part.iter().copied());
}
