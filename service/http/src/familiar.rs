//! Addresses from which each name has signed in, in bounded memory.

use std::collections::HashMap;

/// Latest pairs of a name and an address that a correct password was sent with. A flood of wrong
/// passwords neither adds nor removes any.
#[derive(Debug)]
pub struct Familiar {
    pairs_max: usize,
    /// Order of the last correct password of each pair, as a growing number.
    last_right: HashMap<String, u64>,
    next: u64,
}

impl Familiar {
    /// Makes a memory of at most `pairs_max` pairs.
    pub fn new(pairs_max: usize) -> Self {
        Self {
            pairs_max,
            last_right: HashMap::new(),
            next: 0,
        }
    }

    /// True if a correct password was sent with this pair.
    pub fn knows(&self, pair: &str) -> bool {
        self.last_right.contains_key(pair)
    }

    /// Records a correct password with this pair.
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
