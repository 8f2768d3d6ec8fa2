//! Addresses from which each name has signed in, in bounded memory.

use std::collections::HashMap;

/// Pairs of a name and an address that a right password has come with, the latest. A flood of
/// wrong passwords adds none and removes none.
#[derive(Debug)]
pub struct Familiar {
    pairs_max: usize,
    /// When each was last right, as a number that goes up.
    last_right: HashMap<String, u64>,
    next: u64,
}

impl Familiar {
    /// Remembers `pairs_max` pairs at most.
    pub fn new(pairs_max: usize) -> Self {
        Self {
            pairs_max,
            last_right: HashMap::new(),
            next: 0,
        }
    }

    /// Whether a right password has come with this pair.
    pub fn knows(&self, pair: &str) -> bool {
        self.last_right.contains_key(pair)
    }

    /// Notes that a right password came with this pair.
    pub fn note(&mut self, pair: String) {
        self.last_right.insert(pair, self.next);
        self.next += 1;
        if self.last_right.len() > self.pairs_max {
            let oldest = self.last_right.iter().min_by_key(|(_, at)| **at);
            if let Some(pair) = oldest.map(|(pair, _)| pair.clone()) {
                self.last_right.remove(&pair);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_latest_pairs_are_remembered() {
        let mut familiar = Familiar::new(3);
        for pair in ["a", "b", "c", "a", "d"] {
            familiar.note(pair.to_owned());
        }
        let known = ["a", "b", "c", "d"].map(|pair| familiar.knows(pair));
        assert_eq!(known, [true, false, true, true]);
    }
}
