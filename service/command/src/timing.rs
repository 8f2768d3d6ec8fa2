//! CPU time of a recording's scans.

use std::time::Duration;

use fleetcal_proto::estimate::Timing;

/// Cost of a run over a recording so far. A scan's time is the CPU time from one scan to the next,
/// including decoding and the drive samples between them.
#[derive(Debug, Default)]
pub struct ScanTimes {
    all: Duration,
    since_scan: Duration,
    scans: Vec<Duration>,
}

impl ScanTimes {
    /// Adds work between scans.
    pub fn add(&mut self, spent: Duration) {
        self.all += spent;
        self.since_scan += spent;
    }

    /// Adds the work on a scan.
    pub fn add_scan(&mut self, spent: Duration) {
        self.add(spent);
        self.scans.push(std::mem::take(&mut self.since_scan));
    }

    /// Returns the cost of `duration_s` of recording that took `wall`.
    pub fn timing(mut self, duration_s: f64, wall: Duration) -> Timing {
        self.scans.sort_unstable();
        let wall_s = wall.as_secs_f64();
        Timing {
            scan_median_ms: self.quantile_ms(0.5),
            scan_p99_ms: self.quantile_ms(0.99),
            cpu_s: self.all.as_secs_f64(),
            realtime_factor: if wall_s > 0.0 {
                duration_s / wall_s
            } else {
                0.0
            },
        }
    }

    /// Returns a quantile of the sorted scans' times, ms.
    fn quantile_ms(&self, share: f64) -> f64 {
        let scans = self.scans.len();
        let at = ((scans as f64 * share) as usize).min(scans.saturating_sub(1));
        self.scans
            .get(at)
            .map_or(0.0, |cpu| cpu.as_secs_f64() * 1e3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scan_carries_the_work_before_it() {
        let mut times = ScanTimes::default();
        for _ in 0..99 {
            times.add(Duration::from_millis(1));
            times.add_scan(Duration::from_millis(2));
        }
        times.add_scan(Duration::from_millis(50));
        let timing = times.timing(10.0, Duration::from_secs(2));
        assert!((timing.scan_median_ms - 3.0).abs() < 1e-9);
        assert!((timing.scan_p99_ms - 50.0).abs() < 1e-9);
        assert!((timing.cpu_s - 0.347).abs() < 1e-9);
        assert!((timing.realtime_factor - 5.0).abs() < 1e-9);
    }

    #[test]
    fn no_scan_costs_nothing() {
        let timing = ScanTimes::default().timing(0.0, Duration::ZERO);
        assert_eq!(timing, Timing::default());
    }
}
