//! One robot whose stamps are odd, beside its `calibrate`: what it sends is used.

use super::*;

const MS: i64 = 1_000_000;

/// Makes a drive sample of a winding robot, by stamp.
fn winding(number: i64, stamp_ns: i64, steering_angle: Option<f32>) -> Vec<u8> {
    let angle = (0.03 * number as f32).sin() * 0.3;
    let drive = AckermannDrive {
        speed: 1.0,
        steering_angle: steering_angle.unwrap_or(angle),
        ..Default::default()
    };
    let stamp = Time::from_ns(BEGIN_NS + stamp_ns).unwrap();
    let header = Header {
        stamp,
        frame_id: String::new(),
    };
    AckermannDriveStamped { header, drive }.to_cdr()
}

impl Bench {
    /// Sends wheel odometry of `robot` by a connection.
    pub(super) fn send_from(&self, origin: u64, payload: &[u8]) {
        let arrived = Arrived {
            form: Encoding::Cdr.into(),
            origin: Some(Origin(origin)),
        };
        let (stream, bytes) = (Stream::WheelOdometry, || payload.to_vec());
        self.fleet
            .receive(&id("robot"), stream, arrived, payload.len(), bytes);
    }
}

async fn sent(messages: impl Iterator<Item = Vec<u8>>) -> RobotView {
    let bench = bench(&["robot"]);
    for (number, message) in messages.enumerate() {
        bench.send("robot", Stream::WheelOdometry, &message);
        if number % 50 == 0 {
            bench.worked_off("robot").await;
        }
    }
    bench.worked_off("robot").await;
    bench.check_accounts("robot");
    bench.view("robot")
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn nothing_of_one_robot_is_refused_for_its_stamps() {
    let wrong = |number: i64| number % 3 == 2;
    for (pattern, stamp_ns) in [
        // Two of three frames of a cycle of 10 ms.
        |number: i64| (number * 3 + 1) / 2 * 10 * MS,
        // A scanner of 15 Hz, stamped on delivery.
        |number: i64| number / 2 * 133 * MS + number % 2 * 33 * MS,
        // Whole seconds.
        |number: i64| number / 100 * 1_000 * MS,
        // A clock that stands still.
        |_| 0,
        // 50 Hz, up to 30 ms early or late.
        |number: i64| number * 20 * MS + (number * 7_919 % 61 - 30) * MS,
    ]
    .into_iter()
    .enumerate()
    {
        let messages = (0..600).map(|number| winding(number, stamp_ns(number), None));
        let view = sent(messages).await;
        assert_eq!(view.counters.refused, 0, "pattern {pattern}");
        let kinds: Vec<_> = view.warnings.iter().map(|warning| warning.kind).collect();
        assert!(
            !kinds.contains(&WarningKind::TwoSenders),
            "pattern {pattern}"
        );
    }
    let messages =
        (0..600).map(|number| winding(number, number * 10 * MS, wrong(number).then_some(f32::NAN)));
    let view = sent(messages).await;
    assert_eq!((view.counters.processed, view.counters.refused), (400, 200));
    assert_eq!(view.warnings, []);
}

/// Returns the number of drive samples in the shown estimate.
fn samples(bench: &Bench) -> u64 {
    let estimate = bench.view("robot").estimate;
    estimate.map_or(0, |estimate| estimate.counts.drive_samples)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_was_learnt_of_two_senders_is_neither_shown_nor_stored() {
    let bench = bench(&["robot"]);
    let send = async |number: i64, origin| {
        bench.send_from(origin, &winding(number, number * 10 * MS, None));
        if number % 50 == 49 {
            bench.worked_off("robot").await;
        }
    };
    for number in 0..1_100 {
        send(number, 1).await;
    }
    let event = RobotEvent {
        kind: NoteKind::Reassembled,
        stamp_ns: RobotTime(BEGIN_NS),
        note: String::new(),
    };
    let number = AuditId(1);
    let noted = Noted { number, event };
    bench.fleet.note(&id("robot"), noted).unwrap();
    bench.noted("robot", number).await;
    for number in 1_100..2_050 {
        send(number, 1).await;
    }
    assert!(samples(&bench) >= 2_000);
    for number in 2_050..2_100 {
        send(number, number as u64 % 2).await;
    }
    assert!(bench.view("robot").is_warned(WarningKind::TwoSenders));
    // The last state but one is from 10 s; the one from 20 s may have data of both.
    let shown = samples(&bench);
    assert!((900..=1_150).contains(&shown), "{shown} samples");
    assert!(bench.view("robot").reassembly_open);

    // A killed service writes nothing more.
    let checkpoints = bench.kept.checkpoints.lock().unwrap().clone();
    let again = bench_with(&["robot"], checkpoints, Calibrator::step);
    again.restored("robot").await;
    assert_eq!(samples(&again), shown);
    assert!(again.view("robot").reassembly_open);
}
