//! Tests of a mailbox: messages kept, dropped and counted.

use fleetcal_model::{RobotTime, WallTime};
use fleetcal_proto::Encoding;
use proptest::prelude::*;

use super::*;

fn message(stream: Stream, number: u32) -> Message {
    Message {
        stream,
        form: Encoding::Cdr.into(),
        origin: None,
        arrived_ns: WallTime(0),
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
                drive_samples: 0,
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
    /// Applies random sequences: the order of arrival stays, the limits hold, every lost message is
    /// counted, and no drive sample is dropped while a scan waits.
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
                            mailbox.finish(Outcome::Processed { stamp_ns: RobotTime(1), drive_samples: 0 });
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
