//! A limit on how often somebody may try, in bounded memory.

use std::collections::HashMap;
use std::time::Duration;

/// Limit that admits `burst` attempts of each key at once and then one every `every`: the generic
/// cell rate algorithm (ITU-T I.371), which keeps one time a key. Times are of a clock that never
/// goes back.
#[derive(Debug)]
pub struct Throttle {
    every: Duration,
    burst: u32,
    keys_max: usize,
    /// Time at which a key's attempts so far are worked off.
    worked_off: HashMap<String, Duration>,
}

impl Throttle {
    /// Makes a throttle that remembers at most `keys_max` keys.
    pub fn new(every: Duration, burst: u32, keys_max: usize) -> Self {
        Self {
            every,
            burst,
            keys_max,
            worked_off: HashMap::new(),
        }
    }

    /// Counts an attempt at `now`.
    ///
    /// # Errors
    /// The time to wait if there were too many; the attempt does not count then.
    pub fn take(&mut self, key: &str, now: Duration) -> Result<(), Duration> {
        self.take_several(key, 1, now)
    }

    /// Counts several attempts at `now`, all of them or none. More than the burst count as the
    /// burst.
    ///
    /// # Errors
    /// The time to wait if there were too many.
    pub fn take_several(&mut self, key: &str, tries: u32, now: Duration) -> Result<(), Duration> {
        let tries = tries.min(self.burst);
        let worked_off = self.worked_off.get(key).copied().unwrap_or(now).max(now);
        let full = self.every * self.burst.saturating_sub(tries);
        let ahead = worked_off.saturating_sub(now);
        if ahead > full {
            return Err(ahead.saturating_sub(full));
        }
        self.make_room(key, now);
        self.worked_off.insert(
            key.to_owned(),
            worked_off.saturating_add(self.every * tries),
        );
        Ok(())
    }

    /// Forgets a key's attempts after a correct one.
    pub fn forget(&mut self, key: &str) {
        self.worked_off.remove(key);
    }

    /// Keeps the memory bounded: it drops the keys that are worked off, then the one that will be
    /// first.
    fn make_room(&mut self, key: &str, now: Duration) {
        if self.worked_off.len() < self.keys_max || self.worked_off.contains_key(key) {
            return;
        }
        self.worked_off.retain(|_, worked_off| *worked_off > now);
        if self.worked_off.len() >= self.keys_max {
            let first = self.worked_off.iter().min_by_key(|(_, at)| **at);
            if let Some(key) = first.map(|(key, _)| key.clone()) {
                self.worked_off.remove(&key);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: Duration = Duration::from_secs(1);

    #[test]
    fn a_burst_is_let_through_and_then_one_at_a_time() {
        let mut throttle = Throttle::new(10 * S, 3, 100);
        for _ in 0..3 {
            assert_eq!(throttle.take("a", S), Ok(()));
        }
        assert_eq!(throttle.take("a", S), Err(10 * S));
        assert_eq!(throttle.take("a", 6 * S), Err(5 * S));
        assert_eq!(throttle.take("b", 6 * S), Ok(()));
        assert_eq!(throttle.take("a", 11 * S), Ok(()));
        assert_eq!(throttle.take("a", 11 * S), Err(10 * S));
        throttle.forget("a");
        assert_eq!(throttle.take("a", 11 * S), Ok(()));
    }

    #[test]
    fn several_tries_count_as_so_many() {
        let mut throttle = Throttle::new(S, 10, 100);
        assert_eq!(throttle.take_several("a", 8, S), Ok(()));
        assert_eq!(
            throttle.take_several("a", 8, S),
            Err(6 * S),
            "none of them counts"
        );
        assert_eq!(throttle.take_several("a", 2, S), Ok(()));
        assert_eq!(throttle.take("a", S), Err(S));
        assert_eq!(
            throttle.take_several("a", 99, 20 * S),
            Ok(()),
            "the whole burst"
        );
        assert_eq!(throttle.take("a", 20 * S), Err(S));
    }

    #[test]
    fn the_memory_stays_bounded_under_ever_new_keys() {
        let mut throttle = Throttle::new(10 * S, 1, 50);
        for number in 0..10_000 {
            assert_eq!(throttle.take(&number.to_string(), S), Ok(()));
            assert!(throttle.worked_off.len() <= 50);
        }
        assert_eq!(throttle.take("late", 100 * S), Ok(()));
        assert_eq!(throttle.worked_off.len(), 1);
    }
}
