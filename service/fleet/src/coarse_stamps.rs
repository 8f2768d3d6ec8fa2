//! Detection of stamps that are coarser than their stream's rate, such as whole seconds.

use fleetcal_estimator::RobotTime;
use fleetcal_model::Stream;

/// Messages after which a stream is judged.
const JUDGED_MESSAGES: u32 = 40;

/// Messages of one stream since its last judgement.
#[derive(Debug, Clone, Copy, Default)]
struct Latest {
    /// Stamp and content of the last message.
    last: Option<(RobotTime, u64)>,
    messages: u32,
    /// Messages with the stamp of their predecessor and other content.
    with_same_stamp: u32,
    is_coarse: bool,
}

impl Latest {
    fn take(&mut self, stamp: RobotTime, content: u64) {
        let is_same = |last: (RobotTime, u64)| last.0 == stamp && last.1 != content;
        self.with_same_stamp += u32::from(self.last.is_some_and(is_same));
        self.last = Some((stamp, content));
        self.messages += 1;
        if self.messages == JUDGED_MESSAGES {
            self.is_coarse = 2 * self.with_same_stamp >= self.messages;
            (self.messages, self.with_same_stamp) = (0, 0);
        }
    }
}

/// Detector of streams in which most messages repeat the stamp of their predecessor.
#[derive(Debug, Default)]
pub struct StampWatch {
    streams: [Latest; Stream::COUNT],
}

impl StampWatch {
    /// Counts a message, given its stamp and a hash of its content. Events are left out: several
    /// notes may have one stamp.
    pub fn take(&mut self, stream: Stream, stamp: RobotTime, content: u64) {
        if stream != Stream::Event
            && let Some(latest) = self.streams.get_mut(stream.index())
        {
            latest.take(stamp, content);
        }
    }

    /// Streams whose stamps are coarse.
    pub fn coarse(&self) -> Vec<Stream> {
        let is_coarse = |stream: &Stream| {
            let latest = self.streams.get(stream.index());
            latest.is_some_and(|latest| latest.is_coarse)
        };
        Stream::ALL.iter().copied().filter(is_coarse).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the coarse streams after 200 messages with these stamps, ms.
    fn coarse(stamp_ms: impl Fn(i64) -> i64, copies: u64) -> Vec<Stream> {
        let mut watch = StampWatch::default();
        for number in 0..200 {
            for _ in 0..copies {
                let stamp = RobotTime(stamp_ms(number) * 1_000_000);
                watch.take(Stream::Scan, stamp, number as u64);
            }
        }
        watch.coarse()
    }

    #[test]
    fn stamps_in_whole_seconds_are_named_and_those_of_a_slow_or_doubled_stream_are_not() {
        assert_eq!(coarse(|number| number / 10 * 1_000, 1), [Stream::Scan]);
        assert_eq!(coarse(|_| 7, 1), [Stream::Scan]);
        for (stamp_ms, copies) in [
            (100_i64, 1),
            (100, 2),
            // A scan a second, stamped in whole seconds.
            (1_000, 1),
        ] {
            assert_eq!(coarse(|number| number * stamp_ms, copies), []);
        }
        // One in five stands still.
        assert_eq!(coarse(|number| (number - number / 5) * 10, 1), []);
    }

    #[test]
    fn a_stream_is_judged_again() {
        let mut watch = StampWatch::default();
        let mut take = |number: i64, step_ms: i64| {
            let stamp = RobotTime(number / 100 * 1_000 + number * step_ms);
            watch.take(Stream::WheelOdometry, stamp, number as u64);
            watch.coarse()
        };
        assert_eq!(
            (0..40).map(|number| take(number, 0)).last(),
            Some(vec![Stream::WheelOdometry])
        );
        assert_eq!(
            (40..120).map(|number| take(number, 10)).last(),
            Some(vec![])
        );
    }
}
