//! Messages that are heard before a robot's task begins, while another instance still has the robot.
//!
//! The task before has taken some of them. The task that begins knows which, by the state that it
//! begins with.

use fleetcal_domain::limits::{
    HEARD_BYTES_MAX, HEARD_NOTES_MAX, HEARD_SCANS_MAX, HEARD_WHEEL_ODOMETRY_MAX,
};
use fleetcal_model::Stream;

use super::{Item, Message, Queue, Recipient};

/// Messages that were heard before the task began, by class.
#[derive(Debug, Default)]
pub(super) struct Heard {
    waiting: [usize; Class::COUNT],
    bytes: usize,
    /// Those that were pushed out. They count as dropped once it turns out that the task before had
    /// not taken them.
    pushed_out: [u64; Class::COUNT],
}

/// What is dropped together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Class {
    WheelOdometry,
    Scan,
    Note,
}

impl Class {
    const COUNT: usize = 3;

    pub(super) const fn of(stream: Stream) -> Self {
        match stream {
            Stream::WheelOdometry | Stream::Steering | Stream::Speed => Self::WheelOdometry,
            Stream::Scan | Stream::LidarOdometry => Self::Scan,
            Stream::Event => Self::Note,
        }
    }

    const fn heard_max(self) -> usize {
        match self {
            Self::WheelOdometry => HEARD_WHEEL_ODOMETRY_MAX,
            Self::Scan => HEARD_SCANS_MAX,
            Self::Note => HEARD_NOTES_MAX,
        }
    }
}

impl Heard {
    /// How many wait.
    pub(super) fn len(&self) -> usize {
        self.waiting.iter().sum()
    }

    /// Takes that a message waits no more.
    pub(super) fn left(&mut self, message: &Message) {
        if let Some(waiting) = self.waiting.get_mut(Class::of(message.stream) as usize) {
            *waiting = waiting.saturating_sub(1);
        }
        self.bytes = self.bytes.saturating_sub(message.payload.len());
    }
}

impl Queue {
    /// Takes a message in for a task that has not begun, or not caught up.
    pub(super) fn push_heard(&mut self, message: Message) {
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

    /// Pushes out the oldest of such streams that was heard; whether there is one.
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

    /// What was pushed out was older than a message that the task before had taken, and so taken
    /// too; or older than one that it had not, and is lost.
    pub(super) fn judge_pushed_out(&mut self, class: Class, is_known: bool) {
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

    /// Drops all but the places at which the robot said what it uses: they are counted elsewhere.
    pub(super) fn clear(&mut self, heard_are_counted: bool) {
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
