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
