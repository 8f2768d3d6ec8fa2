//! A robot's bounded mailbox: one queue in the order of arrival, dropped in a fixed order.
//!
//! At most [`fleetcal_domain::limits::MAILBOX_SCANS_MAX`] scans wait; a further one pushes the
//! oldest out. A drive sample that finds the mailbox full pushes out the oldest scan, and only when
//! there is none the oldest drive sample. Nothing is lost without being counted.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use fleetcal_domain::limits::{
    MAILBOX_NOTES_MAX, MAILBOX_SCANS_MAX, MAILBOX_WHEEL_ODOMETRY_MAX, REFUSAL_CHARS_MAX,
};
use fleetcal_domain::robot::Counters;
use fleetcal_estimator::Note;
use fleetcal_model::{RobotTime, Stream};
use fleetcal_proto::message_type::Form;
use fleetcal_proto::progress::Progress;
use tokio::sync::Notify;

use crate::senders::LinkId;

/// Slots that drive samples and scans share.
const SLOTS_MAX: usize = MAILBOX_WHEEL_ODOMETRY_MAX + MAILBOX_SCANS_MAX;

/// A message as it came in, not decoded yet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// The stream it came on.
    pub stream: Stream,
    /// How it is written.
    pub form: Form,
    /// The connection that it came over, where that is known.
    pub link: Option<LinkId>,
    /// Its bytes.
    pub payload: Vec<u8>,
}

/// What waits for a robot's task.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Item {
    /// A message of the robot.
    Message(Message),
    /// A note that came over the API: it is in the history already.
    Note(Note),
    /// The robot's session has ended.
    EndOfSession,
    /// The robot has said what it uses: what stands behind this was sent later, or is in flight.
    ValuesHeard,
}

/// What became of a message that the task took.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// The estimator has it.
    Processed {
        /// Its header stamp, ns since 1970.
        stamp_ns: RobotTime,
    },
    /// It was refused, for this reason.
    Refused(String),
}

#[derive(Debug, Default)]
struct Queue {
    items: VecDeque<Item>,
    wheel_odometry: usize,
    scans: usize,
    notes: usize,
    in_hand: Option<Stream>,
    counters: Counters,
    progress: Progress,
}

/// See the module.
#[derive(Debug, Default)]
pub struct Mailbox {
    queue: Mutex<Queue>,
    arrived: Notify,
}

/// The class of a stream: what is dropped together.
fn is_scan(item: &Item) -> bool {
    matches!(
        item,
        Item::Message(Message {
            stream: Stream::Scan | Stream::LidarOdometry,
            ..
        })
    )
}

fn is_wheel_odometry(item: &Item) -> bool {
    matches!(
        item,
        Item::Message(Message { stream, .. }) if stream.is_wheel_odometry()
    )
}

impl Queue {
    fn drop_oldest_scan(&mut self) {
        if let Some(at) = self.items.iter().position(is_scan) {
            self.items.remove(at);
            self.scans -= 1;
            self.count_dropped_scan();
        }
    }

    fn drop_oldest_wheel_odometry(&mut self) {
        if let Some(at) = self.items.iter().position(is_wheel_odometry) {
            self.items.remove(at);
            self.wheel_odometry -= 1;
            self.counters.dropped_wheel_odometry += 1;
            self.progress.dropped += 1;
        }
    }

    fn count_dropped_scan(&mut self) {
        self.counters.dropped_scans += 1;
        self.progress.dropped += 1;
    }

    fn push_wheel_odometry(&mut self, message: Message) {
        if self.wheel_odometry + self.scans >= SLOTS_MAX
            || self.wheel_odometry >= MAILBOX_WHEEL_ODOMETRY_MAX
        {
            if self.scans > 0 {
                self.drop_oldest_scan();
            }
            if self.wheel_odometry + self.scans >= SLOTS_MAX {
                self.drop_oldest_wheel_odometry();
            }
        }
        self.wheel_odometry += 1;
        self.items.push_back(Item::Message(message));
    }

    fn push_scan(&mut self, message: Message) {
        if self.scans >= MAILBOX_SCANS_MAX {
            self.drop_oldest_scan();
        }
        if self.wheel_odometry + self.scans >= SLOTS_MAX {
            // Only drive samples wait: the scan that comes is the oldest there is.
            self.count_dropped_scan();
            return;
        }
        self.scans += 1;
        self.items.push_back(Item::Message(message));
    }

    fn push_note(&mut self, message: Message) -> bool {
        if self.notes >= MAILBOX_NOTES_MAX {
            self.counters.dropped_notes += 1;
            return false;
        }
        self.notes += 1;
        self.items.push_back(Item::Message(message));
        true
    }
}

impl Mailbox {
    /// The queue holds plain numbers that are right after every statement, so a panic of another
    /// thread leaves nothing half done.
    fn lock(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a message in and drops what no longer fits. `false` when it is the message itself
    /// that was dropped.
    pub fn push(&self, message: Message) -> bool {
        let kept = {
            let mut queue = self.lock();
            queue.counters.received += 1;
            match message.stream {
                Stream::WheelOdometry | Stream::Steering | Stream::Speed => {
                    queue.push_wheel_odometry(message);
                    true
                }
                Stream::Scan | Stream::LidarOdometry => {
                    let dropped_before = queue.counters.dropped_scans;
                    queue.push_scan(message);
                    queue.counters.dropped_scans == dropped_before
                }
                Stream::Event => queue.push_note(message),
            }
        };
        self.arrived.notify_one();
        kept
    }

    /// Counts a message that is refused before it waits.
    pub fn refuse(&self, stream: Stream, reason: &str) {
        let mut queue = self.lock();
        queue.counters.received += 1;
        queue.count_outcome(stream, Outcome::Refused(reason.to_owned()));
    }

    /// Counts a message of a robot that nobody has configured. To its sender it is given up.
    pub fn ignore(&self, stream: Stream) {
        let mut queue = self.lock();
        queue.counters.received += 1;
        queue.counters.ignored += 1;
        queue.progress.dropped += u64::from(stream != Stream::Event);
    }

    /// Puts a note behind what waits; `false` when too many wait.
    pub fn push_note(&self, note: Note) -> bool {
        {
            let mut queue = self.lock();
            if queue.notes >= MAILBOX_NOTES_MAX {
                return false;
            }
            queue.notes += 1;
            queue.items.push_back(Item::Note(note));
        }
        self.arrived.notify_one();
        true
    }

    /// Puts the end of the session behind what waits, unless it stands there already.
    pub fn end_session(&self) {
        {
            let mut queue = self.lock();
            if queue.items.back() != Some(&Item::EndOfSession) {
                queue.items.push_back(Item::EndOfSession);
            }
        }
        self.arrived.notify_one();
    }

    /// Puts the robot's answer about what it uses behind what waits; `false` when one stands there.
    pub fn push_values_heard(&self) -> bool {
        let is_new = {
            let mut queue = self.lock();
            let is_new = queue.items.back() != Some(&Item::ValuesHeard);
            if is_new {
                queue.items.push_back(Item::ValuesHeard);
            }
            is_new
        };
        self.arrived.notify_one();
        is_new
    }

    /// Wakes the task without a message.
    pub fn wake(&self) {
        self.arrived.notify_one();
    }

    /// Waits until something may have come.
    pub async fn arrived(&self) {
        self.arrived.notified().await;
    }

    /// Takes the oldest item; [`Mailbox::finish`] must follow for a message.
    pub fn take(&self) -> Option<Item> {
        let mut queue = self.lock();
        let item = queue.items.pop_front()?;
        if let Item::Message(message) = &item {
            queue.in_hand = Some(message.stream);
            match message.stream {
                Stream::WheelOdometry | Stream::Steering | Stream::Speed => {
                    queue.wheel_odometry -= 1;
                }
                Stream::Scan | Stream::LidarOdometry => queue.scans -= 1,
                Stream::Event => queue.notes -= 1,
            }
        }
        if matches!(item, Item::Note(_)) {
            queue.notes -= 1;
        }
        Some(item)
    }

    /// Says what became of the message that was taken last.
    pub fn finish(&self, outcome: Outcome) {
        let mut queue = self.lock();
        if let Some(stream) = queue.in_hand.take() {
            queue.count_outcome(stream, outcome);
        }
    }

    /// Whether nothing waits and nothing is in hand.
    pub fn is_idle(&self) -> bool {
        let queue = self.lock();
        queue.items.is_empty() && queue.in_hand.is_none()
    }

    /// What became of the messages so far.
    pub fn counters(&self) -> Counters {
        let queue = self.lock();
        let waiting = queue
            .items
            .iter()
            .filter(|item| matches!(item, Item::Message(_)))
            .count();
        Counters {
            waiting: waiting as u64 + u64::from(queue.in_hand.is_some()),
            ..queue.counters.clone()
        }
    }

    /// How far the task has come.
    pub fn progress(&self) -> Progress {
        self.lock().progress
    }
}

impl Queue {
    fn count_outcome(&mut self, stream: Stream, outcome: Outcome) {
        match outcome {
            Outcome::Processed { stamp_ns } => {
                self.counters.processed += 1;
                self.progress.stamp_ns = self.progress.stamp_ns.max(stamp_ns);
                match stream {
                    Stream::WheelOdometry | Stream::Steering | Stream::Speed => {
                        self.progress.drive_samples += 1;
                    }
                    Stream::Scan | Stream::LidarOdometry => self.progress.scans += 1,
                    Stream::Event => {}
                }
            }
            Outcome::Refused(mut reason) => {
                self.progress.dropped += u64::from(stream != Stream::Event);
                if let Some((cut, _)) = reason.char_indices().nth(REFUSAL_CHARS_MAX) {
                    reason.truncate(cut);
                }
                self.counters.refused += 1;
                self.counters.last_refusal = Some(reason);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use fleetcal_proto::Encoding;
    use proptest::prelude::*;

    use super::*;

    fn message(stream: Stream, number: u32) -> Message {
        Message {
            stream,
            form: Encoding::Cdr.into(),
            link: None,
            payload: number.to_le_bytes().to_vec(),
        }
    }

    fn taken(mailbox: &Mailbox) -> Vec<(Stream, u32)> {
        let mut all = Vec::new();
        while let Some(item) = mailbox.take() {
            if let Item::Message(message) = item {
                let bytes: [u8; 4] = message.payload.try_into().expect("four bytes");
                all.push((message.stream, u32::from_le_bytes(bytes)));
                mailbox.finish(Outcome::Processed {
                    stamp_ns: RobotTime(1),
                });
            }
        }
        all
    }

    #[test]
    fn a_ninth_scan_pushes_out_the_oldest() {
        let mailbox = Mailbox::default();
        for number in 0..10 {
            mailbox.push(message(Stream::Scan, number));
        }
        let numbers: Vec<u32> = taken(&mailbox)
            .into_iter()
            .map(|(_, number)| number)
            .collect();
        assert_eq!(numbers, (2..10).collect::<Vec<_>>());
        assert_eq!(mailbox.counters().dropped_scans, 2);
    }

    #[test]
    fn drive_samples_push_out_scans_before_each_other() {
        let mailbox = Mailbox::default();
        mailbox.push(message(Stream::Scan, 0));
        for number in 0..1_024 {
            mailbox.push(message(Stream::WheelOdometry, number));
        }
        assert_eq!(
            (
                mailbox.counters().dropped_scans,
                mailbox.counters().dropped_wheel_odometry
            ),
            (0, 0)
        );
        mailbox.push(message(Stream::WheelOdometry, 1_024));
        assert_eq!(
            (
                mailbox.counters().dropped_scans,
                mailbox.counters().dropped_wheel_odometry
            ),
            (1, 0)
        );
        for number in 1_025..1_040 {
            mailbox.push(message(Stream::WheelOdometry, number));
        }
        assert_eq!(
            (
                mailbox.counters().dropped_scans,
                mailbox.counters().dropped_wheel_odometry
            ),
            (1, 8)
        );
    }

    #[test]
    fn a_long_reason_is_cut_between_characters() {
        let mailbox = Mailbox::default();
        mailbox.refuse(Stream::WheelOdometry, &"ä".repeat(REFUSAL_CHARS_MAX + 7));
        let kept = mailbox.counters().last_refusal.expect("a reason");
        assert_eq!(kept.chars().count(), REFUSAL_CHARS_MAX);
    }

    proptest! {
        /// Whatever comes and goes: the order of arrival stays, the limits hold, no message
        /// vanishes uncounted, and no drive sample is dropped while a scan waits.
        #[test]
        fn nothing_is_lost_uncounted(
            steps in prop::collection::vec((0_u8..12, 1_usize..300), 1..60)
        ) {
            let mailbox = Mailbox::default();
            let mut number = 0;
            let mut seen = Vec::new();
            for (what, times) in steps {
                for _ in 0..times {
                    let stream = match what {
                        0..=4 => Stream::WheelOdometry,
                        5..=7 => Stream::Scan,
                        8 => Stream::LidarOdometry,
                        9 => Stream::Event,
                        _ => {
                            if let Some(Item::Message(message)) = mailbox.take() {
                                let bytes = message.payload.try_into().expect("four bytes");
                                seen.push(u32::from_le_bytes(bytes));
                                mailbox.finish(Outcome::Processed { stamp_ns: RobotTime(1) });
                            }
                            continue;
                        }
                    };
                    let before = mailbox.counters();
                    let scans_waited = mailbox.lock().scans;
                    mailbox.push(message(stream, number));
                    number += 1;
                    let after = mailbox.counters();
                    let queue = mailbox.lock();
                    prop_assert!(queue.wheel_odometry + queue.scans <= SLOTS_MAX);
                    prop_assert!(queue.scans <= MAILBOX_SCANS_MAX);
                    prop_assert!(queue.notes <= MAILBOX_NOTES_MAX);
                    prop_assert!(after.dropped_wheel_odometry == before.dropped_wheel_odometry || scans_waited == 0);
                }
            }
            seen.extend(taken(&mailbox).into_iter().map(|(_, number)| number));
            prop_assert!(seen.is_sorted());
            let counters = mailbox.counters();
            let dropped = counters.dropped_wheel_odometry + counters.dropped_scans + counters.dropped_notes;
            prop_assert_eq!(counters.received, u64::from(number));
            prop_assert_eq!(counters.processed, seen.len() as u64);
            prop_assert_eq!(counters.received, counters.processed + dropped);
            prop_assert_eq!(counters.waiting, 0);
        }
    }
}
