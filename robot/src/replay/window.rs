//! Distance that a sender may run ahead of the service.

use fleetcal_proto::progress::Progress;

/// Most drive samples in flight: half of what a robot's mailbox holds, because a service that
/// restarts may hold as many again that it has not reported.
pub const AHEAD_DRIVE_SAMPLES_MAX: u64 = 512;
/// Most scans or LiDAR poses in flight, likewise.
pub const AHEAD_SCANS_MAX: u64 = 4;

/// Difference between the sent messages and those that the service reports as processed.
///
/// The service counts from its own start, so its first report is the zero. When its counts fall, it
/// was restarted: the messages in flight then are lost or counted already, and the window is empty
/// again.
#[derive(Debug, Clone)]
pub struct Window {
    sent: Sent,
    /// Messages sent before the service's present counts began.
    sent_before: Sent,
    zero: Progress,
    latest: Progress,
    dropped_before: u64,
    unconfirmed: u64,
}

/// Change of the service's report against the one before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Report {
    /// The service processed something.
    MovedOn,
    /// The counts are the same.
    Unmoved,
    /// The counts fell: the service was restarted.
    StartedAnew,
}

#[derive(Debug, Clone, Copy, Default)]
struct Sent {
    drive_samples: u64,
    scans: u64,
}

impl Sent {
    fn sum(self) -> u64 {
        self.drive_samples + self.scans
    }
}

impl Window {
    /// Makes an empty window; `progress` is the service's report before the first message, if it
    /// knows the robot.
    pub fn new(progress: Option<Progress>) -> Self {
        let zero = progress.unwrap_or_default();
        let none = Sent::default();
        Self {
            sent: none,
            sent_before: none,
            zero,
            latest: zero,
            dropped_before: 0,
            unconfirmed: 0,
        }
    }

    /// True if one more message may be sent.
    pub fn has_room(&self, is_wheel_odometry: bool) -> bool {
        if is_wheel_odometry {
            self.drive_samples_ahead() < AHEAD_DRIVE_SAMPLES_MAX
        } else {
            self.scans_ahead() < AHEAD_SCANS_MAX
        }
    }

    /// Counts a message that was sent.
    pub fn count_sent(&mut self, is_wheel_odometry: bool) {
        if is_wheel_odometry {
            self.sent.drive_samples += 1;
        } else {
            self.sent.scans += 1;
        }
    }

    /// Compares the service's report with the one before.
    pub fn report(&mut self, progress: Progress) -> Report {
        let counts = |report: &Progress| [report.drive_samples, report.scans, report.dropped];
        let (before, now) = (counts(&self.latest), counts(&progress));
        if before.iter().zip(now).any(|(&before, now)| now < before) {
            self.restart(progress);
            return Report::StartedAnew;
        }
        self.latest = progress;
        if before == now {
            Report::Unmoved
        } else {
            Report::MovedOn
        }
    }

    /// Abandons the messages in flight: the service counts again from `progress`.
    pub fn restart(&mut self, progress: Progress) {
        self.unconfirmed += self.outstanding();
        self.dropped_before = self.dropped();
        self.sent_before = self.sent;
        (self.zero, self.latest) = (progress, progress);
    }

    /// True if the service has processed all sent messages.
    pub fn is_done(&self) -> bool {
        self.outstanding() == 0
    }

    /// Returns the number of messages in flight or waiting.
    pub fn outstanding(&self) -> u64 {
        let done = self.drive_samples_done() + self.scans_done() + self.dropped_now();
        (self.sent.sum() - self.sent_before.sum()).saturating_sub(done)
    }

    /// Returns the number of sent messages.
    pub fn sent(&self) -> u64 {
        self.sent.sum()
    }

    /// Returns the number of sent drive samples.
    pub fn sent_drive_samples(&self) -> u64 {
        self.sent.drive_samples
    }

    /// Returns the number of sent scans or LiDAR poses.
    pub fn sent_scans(&self) -> u64 {
        self.sent.scans
    }

    /// Returns the number of messages that the service dropped since the window was made.
    pub fn dropped(&self) -> u64 {
        self.dropped_before + self.dropped_now()
    }

    /// Returns the number of messages in flight when the service was restarted: lost with it, or
    /// counted by nobody.
    pub fn unconfirmed(&self) -> u64 {
        self.unconfirmed
    }

    // The report does not say of which stream the dropped messages were; either stream may count on
    // their room, because what was dropped waits nowhere.
    fn drive_samples_ahead(&self) -> u64 {
        let sent = self.sent.drive_samples - self.sent_before.drive_samples;
        sent.saturating_sub(self.drive_samples_done() + self.dropped_now())
    }

    fn scans_ahead(&self) -> u64 {
        let sent = self.sent.scans - self.sent_before.scans;
        sent.saturating_sub(self.scans_done() + self.dropped_now())
    }

    fn drive_samples_done(&self) -> u64 {
        self.latest
            .drive_samples
            .saturating_sub(self.zero.drive_samples)
    }

    fn scans_done(&self) -> u64 {
        self.latest.scans.saturating_sub(self.zero.scans)
    }

    fn dropped_now(&self) -> u64 {
        self.latest.dropped.saturating_sub(self.zero.dropped)
    }
}

#[cfg(test)]
mod tests {
    use fleetcal_model::RobotTime;

    use super::*;

    fn progress(drive_samples: u64, scans: u64, dropped: u64) -> Progress {
        Progress {
            drive_samples,
            scans,
            dropped,
            stamp_ns: RobotTime(1),
        }
    }

    fn filled() -> Window {
        let mut window = Window::new(Some(progress(1000, 100, 7)));
        for _ in 0..AHEAD_DRIVE_SAMPLES_MAX {
            assert!(window.has_room(true));
            window.count_sent(true);
        }
        for _ in 0..AHEAD_SCANS_MAX {
            assert!(window.has_room(false));
            window.count_sent(false);
        }
        assert!(!window.has_room(true) && !window.has_room(false));
        window
    }

    #[test]
    fn room_comes_with_progress_on_the_same_stream() {
        let mut window = filled();
        assert_eq!(window.report(progress(1000, 100, 7)), Report::Unmoved);
        assert_eq!(window.report(progress(1010, 100, 7)), Report::MovedOn);
        assert!(window.has_room(true) && !window.has_room(false));
        assert_eq!(window.report(progress(1010, 101, 7)), Report::MovedOn);
        assert!(window.has_room(false));
        assert_eq!(window.outstanding(), 512 + 4 - 11);
        assert_eq!(window.report(progress(1512, 104, 7)), Report::MovedOn);
        assert!(window.is_done());
        assert_eq!(window.dropped(), 0);
    }

    #[test]
    fn what_was_shed_is_not_waited_for() {
        let mut window = filled();
        window.report(progress(1510, 103, 10));
        assert!(window.is_done());
        assert_eq!(window.dropped(), 3);
    }

    #[test]
    fn a_service_that_starts_anew_empties_the_window() {
        let mut window = filled();
        window.report(progress(1200, 102, 9));
        assert_eq!(window.report(progress(3, 0, 0)), Report::StartedAnew);
        assert!(window.is_done(), "{} outstanding", window.outstanding());
        assert_eq!((window.dropped(), window.unconfirmed()), (2, 516 - 204));
        window.count_sent(true);
        window.count_sent(false);
        assert_eq!(window.outstanding(), 2);
        window.report(progress(4, 1, 0));
        assert!(window.is_done());
        assert_eq!((window.sent_drive_samples(), window.sent_scans()), (513, 5));
    }

    #[test]
    fn a_robot_that_is_not_known_yet_starts_from_zero() {
        let mut window = Window::new(None);
        window.count_sent(true);
        assert!(!window.is_done());
        window.report(progress(1, 0, 0));
        assert!(window.is_done());
    }
}
