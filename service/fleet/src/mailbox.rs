//! A robot's bounded mailbox: one queue in the order of arrival, dropped in a fixed order.
//!
//! At most [`fleetcal_domain::limits::MAILBOX_SCANS_MAX`] scans wait; a further one pushes the
//! oldest out. A drive sample that finds the mailbox full pushes out the oldest scan, and only when
//! there is none the oldest drive sample. Nothing is lost without being counted.
//!
//! Where several instances carry the fleet, a robot's messages are kept for a task that is to begin
//! here while another instance still has the robot; more of them, since nobody works them off.

mod heard;
mod message;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use fleetcal_domain::limits::{
    HEARD_BYTES_MAX, MAILBOX_NOTES_MAX, MAILBOX_SCANS_MAX, MAILBOX_WHEEL_ODOMETRY_MAX,
    REFUSAL_CHARS_MAX, TASK_ROUND_WHEEL_ODOMETRY_MAX,
};
use fleetcal_domain::robot::Counters;
use fleetcal_model::Stream;
use fleetcal_proto::progress::Progress;
use tokio::sync::Notify;

use heard::{Class, Heard};

use crate::notes::Noted;

pub use message::{Item, Message, Outcome, Recipient};

/// Slots that drive samples and scans share.
const SLOTS_MAX: usize = MAILBOX_WHEEL_ODOMETRY_MAX + MAILBOX_SCANS_MAX;

#[derive(Debug, Default)]
struct Queue {
    recipient: Recipient,
    items: VecDeque<Item>,
    wheel_odometry: usize,
    scans: usize,
    notes: usize,
    /// Part of `items` that was received before the task began.
    heard: Heard,
    in_hand: Option<InHand>,
    counters: Counters,
    progress: Progress,
}

/// Message that the task is processing.
#[derive(Debug, Clone, Copy)]
struct InHand {
    stream: Stream,
    was_heard: bool,
}

/// Mailbox of a robot; see the module.
#[derive(Debug, Default)]
pub struct Mailbox {
    queue: Mutex<Queue>,
    arrived: Notify,
    /// Signal of items that do not wait for the task's next round.
    pressing: Notify,
}

/// True if a stream belongs to the class of scans, which are dropped together.
fn is_scan(item: &Item) -> bool {
    matches!(
        item,
        Item::Message(Message {
            stream: Stream::Scan | Stream::LidarOdometry,
            ..
        })
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
        let at = self.items.iter().position(Item::is_wheel_odometry);
        if let Some(Item::Message(message)) = at.and_then(|at| self.items.remove(at)) {
            self.wheel_odometry -= 1;
            self.counters.dropped_wheel_odometry += 1;
            self.counters.dropped_drive_samples += message.drive_samples();
            self.progress.dropped += 1;
        }
    }

    /// True if the waiting items are to be processed at once.
    fn is_pressing(&self) -> bool {
        self.notes > 0 || self.scans > 0 || self.wheel_odometry > TASK_ROUND_WHEEL_ODOMETRY_MAX
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

impl Queue {
    /// Adds a message for a task that has not begun, or not caught up.
    fn push_heard(&mut self, message: Message) {
        let class = Class::of(message.stream);
        let waiting = |queue: &Self| queue.heard.waiting.get(class as usize).copied();
        if waiting(self) >= Some(class.heard_max()) {
            let of_class = |stream| Class::of(stream) == class;
            self.push_out_heard(of_class);
        }
        while self.heard.bytes + message.payload.len() > HEARD_BYTES_MAX
            && self.push_out_heard(|_| true)
        {}
        self.heard.bytes += message.payload.len();
        if let Some(waiting) = self.heard.waiting.get_mut(class as usize) {
            *waiting += 1;
        }
        self.items.push_back(Item::Heard(message));
    }

    /// Drops the oldest early message of the given streams; returns whether there was one.
    fn push_out_heard(&mut self, of: impl Fn(Stream) -> bool) -> bool {
        let oldest = |item: &Item| matches!(item, Item::Heard(message) if of(message.stream));
        let at = self.items.iter().position(oldest);
        let Some(Item::Heard(message)) = at.and_then(|at| self.items.remove(at)) else {
            return false;
        };
        self.heard.left(&message);
        let class = Class::of(message.stream);
        if let Some(pushed_out) = self.heard.pushed_out.get_mut(class as usize) {
            *pushed_out += 1;
        }
        if self.recipient == Recipient::Task {
            // It is counted again with those that were pushed out, if it was lost.
            self.counters.received = self.counters.received.saturating_sub(1);
        }
        true
    }

    /// Counts the early messages that were dropped: as lost, unless the message after them was
    /// known to the former task, and so they were too.
    fn judge_pushed_out(&mut self, class: Class, is_known: bool) {
        let Some(pushed_out) = self.heard.pushed_out.get_mut(class as usize) else {
            return;
        };
        let lost = if is_known { 0 } else { *pushed_out };
        *pushed_out = 0;
        self.counters.received += lost;
        self.progress.dropped += lost;
        match class {
            Class::WheelOdometry => self.counters.dropped_wheel_odometry += lost,
            Class::Scan => self.counters.dropped_scans += lost,
            Class::Note => self.counters.dropped_notes += lost,
        }
    }

    /// Drops all items except the markers of the robot's reports on its values, which are counted
    /// elsewhere.
    fn clear(&mut self, heard_are_counted: bool) {
        let is_counted = |item: &&Item| match item {
            Item::Message(_) => true,
            Item::Heard(_) => heard_are_counted,
            _ => false,
        };
        let gone = self.items.iter().filter(is_counted).count() as u64;
        self.counters.received = self.counters.received.saturating_sub(gone);
        self.items.retain(|item| *item == Item::ValuesHeard);
        (self.wheel_odometry, self.scans, self.notes) = (0, 0, 0);
        self.heard = Heard::default();
    }
}

impl Mailbox {
    /// Locks the queue. It holds plain numbers that are right after every statement, so a panic of
    /// another thread leaves nothing half done.
    fn lock(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a message and drops whatever no longer fits. Returns `false` if the message itself was
    /// dropped.
    pub fn push(&self, message: Message) -> bool {
        let (kept, is_pressing) = {
            let mut queue = self.lock();
            match queue.recipient {
                Recipient::Nobody => return false,
                Recipient::Heir => {
                    queue.push_heard(message);
                    return true;
                }
                Recipient::Task => queue.counters.received += 1,
            }
            // The task has not caught up yet.
            let is_behind = queue.heard.len() > 0;
            let kept = match message.stream {
                _ if is_behind => {
                    queue.push_heard(message);
                    true
                }
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
            };
            (kept, is_behind || queue.is_pressing())
        };
        self.arrived.notify_one();
        if is_pressing {
            self.pressing.notify_one();
        }
        kept
    }

    /// Counts a message that is refused before it waits.
    pub fn refuse(&self, stream: Stream, reason: &str) {
        let mut queue = self.lock();
        queue.counters.received += 1;
        queue.count_outcome(stream, Outcome::Refused(reason.to_owned()));
    }

    /// Counts a message of a robot that nobody has configured. Its sender sees it as dropped.
    pub fn ignore(&self, stream: Stream) {
        let mut queue = self.lock();
        queue.counters.received += 1;
        queue.counters.ignored += 1;
        queue.progress.dropped += u64::from(stream != Stream::Event);
    }

    /// Appends a note; returns `false` if too many wait.
    pub fn push_note(&self, note: Noted) -> bool {
        {
            let mut queue = self.lock();
            if queue.notes >= MAILBOX_NOTES_MAX {
                return false;
            }
            queue.notes += 1;
            queue.items.push_back(Item::Note(note));
        }
        self.wake();
        true
    }

    /// True if there is room for another note.
    pub fn has_room_for_note(&self) -> bool {
        self.lock().notes < MAILBOX_NOTES_MAX
    }

    /// Appends the end of the session, unless it is the last item already.
    pub fn end_session(&self) {
        {
            let mut queue = self.lock();
            if queue.items.back() != Some(&Item::EndOfSession) {
                queue.items.push_back(Item::EndOfSession);
            }
        }
        self.wake();
    }

    /// Appends the marker of the robot's report on its values; returns `false` if it is the last
    /// item already.
    pub fn push_values_heard(&self) -> bool {
        let is_new = {
            let mut queue = self.lock();
            let is_new = queue.items.back() != Some(&Item::ValuesHeard);
            if is_new {
                queue.items.push_back(Item::ValuesHeard);
            }
            is_new
        };
        self.wake();
        is_new
    }

    /// Wakes the task, with or without a message, without waiting for its next round.
    pub fn wake(&self) {
        self.arrived.notify_one();
        self.pressing.notify_one();
    }

    /// Waits until something may have come.
    pub async fn arrived(&self) {
        self.arrived.notified().await;
    }

    /// Waits until something has come that does not wait for the next round.
    pub async fn pressing(&self) {
        self.pressing.notified().await;
    }

    /// Removes and returns the oldest item; for a message, [`Mailbox::finish`] must follow.
    pub fn take(&self) -> Option<Item> {
        let mut queue = self.lock();
        let item = queue.items.pop_front()?;
        if let Item::Heard(message) = &item {
            queue.in_hand = Some(InHand {
                stream: message.stream,
                was_heard: true,
            });
            queue.heard.left(message);
        }
        if let Item::Message(message) = &item {
            queue.in_hand = Some(InHand {
                stream: message.stream,
                was_heard: false,
            });
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

    /// Records the outcome of the message that was removed last.
    pub fn finish(&self, outcome: Outcome) {
        let mut queue = self.lock();
        if let Some(InHand { stream, was_heard }) = queue.in_hand.take() {
            if was_heard {
                queue.judge_pushed_out(Class::of(stream), outcome == Outcome::Known);
            }
            queue.count_outcome(stream, outcome);
        }
    }

    /// True if the queue is empty and the task is processing nothing.
    pub fn is_idle(&self) -> bool {
        let queue = self.lock();
        queue.items.is_empty() && queue.in_hand.is_none()
    }

    /// Returns the counters of messages by outcome so far.
    pub fn counters(&self) -> Counters {
        let queue = self.lock();
        let is_own = queue.recipient != Recipient::Heir;
        let counts = |item: &&Item| match item {
            Item::Message(_) => true,
            Item::Heard(_) => is_own,
            _ => false,
        };
        let waiting = queue.items.iter().filter(counts).count();
        Counters {
            waiting: waiting as u64 + u64::from(queue.in_hand.is_some()),
            ..queue.counters.clone()
        }
    }

    /// Returns the progress of the task.
    pub fn progress(&self) -> Progress {
        self.lock().progress
    }

    /// Returns the recipient of new messages.
    pub fn recipient(&self) -> Recipient {
        self.lock().recipient
    }

    /// Begins to keep messages for a task that is to begin. Returns `false` if it does so already,
    /// or there is a task.
    pub fn hear(&self) -> bool {
        let mut queue = self.lock();
        let begins = queue.recipient == Recipient::Nobody;
        if begins {
            queue.recipient = Recipient::Heir;
        }
        begins
    }

    /// Drops the early messages, as no task is to begin. Returns `false` if none were to be kept.
    pub fn unhear(&self) -> bool {
        let mut queue = self.lock();
        let ends = queue.recipient == Recipient::Heir;
        if ends {
            queue.recipient = Recipient::Nobody;
            queue.clear(false);
        }
        ends
    }

    /// Begins to accept messages for the task that begins. Returns `false` if there is one.
    pub fn open(&self) -> bool {
        let mut queue = self.lock();
        let opens = queue.recipient != Recipient::Task;
        if opens {
            queue.recipient = Recipient::Task;
            queue.counters.received += queue.heard.len() as u64;
        }
        opens
    }

    /// Stops accepting messages. Returns `false` if there was no task to accept them for.
    pub fn close(&self) -> bool {
        let mut queue = self.lock();
        let closes = queue.recipient == Recipient::Task;
        if closes {
            queue.recipient = Recipient::Nobody;
        }
        closes
    }

    /// Drops the waiting items, which belong to another instance by now.
    pub fn clear(&self) {
        self.lock().clear(true);
    }
}

impl Queue {
    fn count_outcome(&mut self, stream: Stream, outcome: Outcome) {
        match outcome {
            Outcome::Processed {
                stamp_ns,
                drive_samples,
            } => {
                self.counters.processed += 1;
                self.counters.drive_samples += drive_samples;
                self.progress.stamp_ns = self.progress.stamp_ns.max(stamp_ns);
                match stream {
                    Stream::WheelOdometry | Stream::Steering | Stream::Speed => {
                        self.progress.drive_samples += 1;
                    }
                    Stream::Scan | Stream::LidarOdometry => self.progress.scans += 1,
                    Stream::Event => {}
                }
            }
            Outcome::Known => self.counters.received = self.counters.received.saturating_sub(1),
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
