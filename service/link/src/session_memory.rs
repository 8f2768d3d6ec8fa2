//! Shortage of memory, by which Zenoh sessions are closed.

use std::time::Duration;

use fleetcal_domain::limits::{
    ZENOH_SESSION_MEMORY_LEAST_BYTES, ZENOH_SESSION_MEMORY_OWNERS_MAX, ZENOH_SESSION_MEMORY_PART,
    ZENOH_SESSION_MEMORY_RECENT, ZENOH_SESSION_MEMORY_SETTLED_QUARTERS,
};

/// Memory of the process that its sessions are closed by.
#[derive(Debug, Clone, Copy)]
pub struct SessionMemory {
    /// Returns the resident memory of the process, bytes; `None` where that is not known.
    pub resident: fn() -> Option<u64>,
    /// Memory that the process may use, bytes.
    pub allowed_bytes: u64,
}

/// Resident memory of the last moments, measured again and again.
///
/// Unfinished messages fill memory within milliseconds, robots within minutes. So memory is short
/// where a part of what was free a moment ago has gone. Memory that grows slowly is short where the
/// same part is gone of what is free beyond the largest settled memory. What stays although several
/// owners' sessions were closed is held by something else, and counts as settled.
#[derive(Debug)]
pub struct MemoryWatch {
    allowed_bytes: u64,
    /// Least bytes of the time before `since`, and of the time since.
    least: [u64; 2],
    since: Duration,
    /// Bytes that closing did not free.
    held_otherwise: u64,
    /// Measurements in a row at which memory was short.
    short: u32,
}

impl MemoryWatch {
    /// Begins with a process that may use so many bytes.
    pub const fn new(allowed_bytes: u64) -> Self {
        Self {
            allowed_bytes,
            least: [u64::MAX; 2],
            since: Duration::ZERO,
            held_otherwise: 0,
            short: 0,
        }
    }

    /// Takes a measurement at a time of a clock that only runs on; true if an owner's sessions are
    /// to be closed. One closing has a measurement's time to show.
    pub fn is_to_close(&mut self, now: Duration, resident_bytes: u64) -> bool {
        if !self.is_short(now, resident_bytes) {
            self.short = 0;
            return false;
        }
        self.short += 1;
        if self.short > 2 * ZENOH_SESSION_MEMORY_OWNERS_MAX {
            self.held_otherwise = resident_bytes;
            self.short = 0;
            return false;
        }
        self.short % 2 == 1
    }

    fn is_short(&mut self, now: Duration, resident_bytes: u64) -> bool {
        if now.saturating_sub(self.since) > ZENOH_SESSION_MEMORY_RECENT {
            self.least = [self.least[1], u64::MAX];
            self.since = now;
        }
        self.least[1] = self.least[1].min(resident_bytes);
        self.held_otherwise = self.held_otherwise.min(resident_bytes);
        let settled = self.allowed_bytes / 4 * ZENOH_SESSION_MEMORY_SETTLED_QUARTERS;
        let least = self.least[0].min(self.least[1]).min(settled);
        let before = least.max(self.held_otherwise);
        let free = self.allowed_bytes.saturating_sub(before);
        let growth = free / ZENOH_SESSION_MEMORY_PART;
        resident_bytes > before + growth.max(ZENOH_SESSION_MEMORY_LEAST_BYTES.min(free))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MIB: u64 = 1 << 20;

    /// Returns the MiB at which memory that grows so fast from a size is first short.
    fn short_at(from_mib: u64, mib_per_s: u64) -> u64 {
        let mut watch = MemoryWatch::new(256 * MIB);
        (0..600_000)
            .map(|ms| (ms, from_mib * MIB + ms * mib_per_s * MIB / 1_000))
            .find(|&(ms, bytes)| watch.is_to_close(Duration::from_millis(ms), bytes))
            .map_or(0, |(_, bytes)| bytes / MIB)
    }

    #[test]
    fn memory_is_short_once_a_quarter_of_what_was_free_is_gone() {
        assert_eq!(short_at(60, 1_000), 110);
        // Beside what one request may need for a moment.
        assert_eq!(short_at(180, 1_000), 213);
        assert_eq!((short_at(60, 2), short_at(180, 2)), (224, 224));
    }

    #[test]
    fn a_process_that_holds_what_it_held_is_not_short() {
        let mut watch = MemoryWatch::new(256 * MIB);
        let mut at = |s, mib| watch.is_to_close(Duration::from_secs(s), mib * MIB);
        assert!((0..10).all(|s| !at(s, 60)));
        assert!(at(10, 120));
        assert!(!at(11, 70));
        // What stays has settled a second later.
        assert!(at(12, 200));
        assert!((13..20).all(|s| !at(s, 200)));
        assert!(at(20, 240));
    }

    #[test]
    fn memory_that_no_session_holds_closes_a_few_owners_and_no_more() {
        let mut watch = MemoryWatch::new(256 * MIB);
        let mut closed = |from_ms: u64, mib| {
            let looks = (from_ms..from_ms + 60_000).step_by(5);
            let to_close =
                looks.filter(|&ms| watch.is_to_close(Duration::from_millis(ms), mib * MIB));
            to_close.count()
        };
        let most = ZENOH_SESSION_MEMORY_OWNERS_MAX as usize;
        assert_eq!(closed(0, 60), 0);
        assert_eq!(closed(60_000, 230), most);
        assert_eq!(closed(120_000, 230), 0);
        // Once it was free again, it counts again.
        assert_eq!(closed(180_000, 100), 0);
        assert_eq!(closed(240_000, 230), most);
    }
}
