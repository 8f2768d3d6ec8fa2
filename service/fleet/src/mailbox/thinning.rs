//! Even share of a robot's scans where CPU time is short.
//!
//! A scan costs a hundred times what a drive sample does, and LiDAR odometry goes on with fewer
//! scans as long as they come evenly. So a robot that falls behind has every second of its scans
//! processed, or every third, and the others are dropped before they wait or are decoded. Tasks have
//! equal turns, so robots have equal shares. One that has caught up has more of them again.

use fleetcal_domain::limits::{MAILBOX_SCANS_BEHIND, SCAN_STRIDE_MAX};

/// Scans that arrive while none waits before one more of them is used.
const CALM_SCANS: u32 = 6;

/// Choice of the scans that a mailbox accepts: one of every `stride`.
#[derive(Debug)]
pub(super) struct Thinning {
    stride: u32,
    /// Scans since the last accepted one.
    since: u32,
    /// Scans that arrived since one found another waiting.
    calm: u32,
    /// Scans that waited when the last one was accepted.
    waited: usize,
}

impl Default for Thinning {
    fn default() -> Self {
        Self {
            stride: 1,
            since: 0,
            calm: 0,
            waited: 0,
        }
    }
}

impl Thinning {
    /// True if the next scan is accepted, given the number of those that wait.
    pub fn accepts(&mut self, waiting: usize) -> bool {
        self.since += 1;
        if self.since < self.stride {
            return false;
        }
        let passed = std::mem::take(&mut self.since);
        self.calm = if waiting == 0 { self.calm + passed } else { 0 };
        let is_behind = waiting >= MAILBOX_SCANS_BEHIND && waiting >= self.waited;
        if is_behind {
            self.stride = (self.stride + 1).min(SCAN_STRIDE_MAX);
        } else if self.calm >= CALM_SCANS {
            self.stride = self.stride.saturating_sub(1).max(1);
            self.calm = 0;
        }
        self.waited = waiting;
        true
    }

    /// True if scans are left out.
    pub const fn is_thinning(&self) -> bool {
        self.stride > 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers of the scans that a task processes, of `scans` that arrive, where it may process
    /// `scans_a_turn` at every `every`-th arrival; and those that wait at the end.
    fn processed(
        thinning: &mut Thinning,
        scans: std::ops::Range<u32>,
        every: u32,
        scans_a_turn: usize,
    ) -> Vec<u32> {
        let (mut waiting, mut done) = (std::collections::VecDeque::new(), Vec::new());
        for scan in scans {
            if thinning.accepts(waiting.len()) {
                waiting.push_back(scan);
            }
            if scan % every == 0 {
                done.extend(waiting.drain(..scans_a_turn.min(waiting.len())));
            }
        }
        done
    }

    fn gaps(scans: &[u32]) -> Vec<u32> {
        scans.windows(2).map(|pair| pair[1] - pair[0]).collect()
    }

    #[test]
    fn a_task_that_keeps_up_has_every_scan() {
        let mut thinning = Thinning::default();
        assert_eq!(processed(&mut thinning, 0..600, 1, 1).len(), 600);
        // Stalls of up to three scans are waited for.
        assert_eq!(processed(&mut thinning, 600..1_200, 3, 3).len(), 598);
        assert!(!thinning.is_thinning());
    }

    #[test]
    fn a_task_with_half_to_an_eighth_of_the_time_has_an_even_share() {
        for every in [2, 3, 4, 8] {
            let mut thinning = Thinning::default();
            let done = processed(&mut thinning, 0..2_000, every, 1);
            let settled = &gaps(&done)[50..];
            let (least, most) = (settled.iter().min(), settled.iter().max());
            assert!(least >= Some(&(every / 2)), "{every}: {settled:?}");
            assert!(most <= Some(&(every + 2)), "{every}: {settled:?}");
            let share = 2_000 / every as usize;
            assert!(done.len() * 10 > share * 8, "{every}: {} scans", done.len());
        }
    }

    #[test]
    fn a_task_that_runs_in_bursts_has_an_even_share_too() {
        // Eight scans every two seconds: without a choice it would have eight in a row, and none
        // of the twelve that follow.
        let mut thinning = Thinning::default();
        let done = processed(&mut thinning, 0..2_000, 20, 8);
        let settled = &gaps(&done)[100..];
        let (least, most) = (settled.iter().min(), settled.iter().max());
        assert!(least >= Some(&2), "{settled:?}");
        assert!(most <= Some(&7), "{settled:?}");
    }

    #[test]
    fn all_scans_are_used_five_seconds_after_the_load_ends() {
        let mut thinning = Thinning::default();
        processed(&mut thinning, 0..500, 500, 8);
        assert_eq!(thinning.stride, SCAN_STRIDE_MAX);
        let done = processed(&mut thinning, 500..600, 1, 8);
        assert!(!thinning.is_thinning());
        let late = done.iter().filter(|&&scan| scan >= 550).count();
        assert_eq!(late, 50);
    }
}
