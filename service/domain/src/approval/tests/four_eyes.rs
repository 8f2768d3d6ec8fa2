//! Number of approvers of a change, whoever moves the mark that it is measured from.

use fleetcal_model::{Pose2, WallTime};
use fleetcal_proto::calibration::CalibrationValues;

use super::bench::{Bench, estimate, factory, nominal, person};
use crate::access::Actor;
use crate::approval::{
    Command, Drawing, Evidence, Origin, Refused, SecondApprover, Tolerance, automatic,
};

/// Values of a LiDAR at this distance from its drawing, m.
fn moved(by_m: f64) -> CalibrationValues {
    CalibrationValues {
        lidar_x_m: nominal().lidar_x_m + by_m,
        ..nominal()
    }
}

#[expect(clippy::unnecessary_wraps, reason = "a robot may have none")]
fn drawing(by_m: f64, by: Option<&str>) -> Option<Drawing> {
    Some(Drawing {
        values: moved(by_m),
        by: by.map(str::to_owned),
    })
}

/// Bench of a robot with this drawing and without any approval.
fn new(drawing: Option<Drawing>) -> Bench {
    Bench {
        drawing,
        ..Bench::new()
    }
}

impl Bench {
    fn propose(&mut self, values: CalibrationValues, by: &Actor) {
        let command = Command::Propose {
            origin: Origin::Person,
            values,
            sigmas: CalibrationValues::default(),
            evidence: Evidence::default(),
            reason: None,
        };
        self.take(command, by);
    }

    /// Approvals that the open proposal needs, and the reason for more than one.
    fn asks(&self) -> (u32, Option<SecondApprover>) {
        let open = self.ledger.open.as_ref().unwrap();
        (open.approvals_needed, open.second_approver)
    }

    fn is_approved_by(&mut self, name: &str) -> bool {
        self.approve_as(name).unwrap();
        self.ledger.open.is_none()
    }

    /// Brings values to the robot and verifies them.
    fn prove(&mut self, offset_rad: f64) {
        self.do_due(&estimate(offset_rad, 0), false);
        for name in ["ana", "bruno"] {
            if self.ledger.open.is_some() {
                self.approve_as(name).unwrap();
            }
        }
        self.try_out();
        assert_eq!(self.do_due(&estimate(offset_rad, 20), true), Some("verify"));
    }
}

#[test]
fn what_is_unknown_counts_as_the_drawing_and_without_one_as_beyond() {
    use SecondApprover as Why;
    for (drawing, offset_rad, needed) in [
        (drawing(0.0, None), 0.05, (1, None)),
        (drawing(0.0, None), 0.09, (2, Some(Why::Beyond))),
        (drawing(-0.1, None), 0.05, (2, Some(Why::Beyond))),
        (None, 0.09, (2, Some(Why::Unknown))),
        (None, 0.001, (2, Some(Why::Unknown))),
    ] {
        let mut bench = new(drawing.clone());
        bench.do_due(&estimate(offset_rad, 0), false);
        assert_eq!(bench.asks(), needed, "{offset_rad} {drawing:?}");
        assert_eq!(bench.is_approved_by("ana"), needed.0 == 1);
    }
    // What was approved is known from then on.
    let mut bench = new(None);
    bench.prove(0.05);
    bench.propose(moved(0.01), &person("carla"));
    assert_eq!(bench.asks(), (1, None));
}

#[test]
fn who_moves_the_drawing_gains_nothing_by_it() {
    // Next to what is proposed, and back once it is proposed.
    let mut bench = new(drawing(2.1, Some("mallory")));
    bench.propose(moved(2.1), &person("mallory"));
    assert_eq!(bench.asks(), (2, Some(SecondApprover::OwnDrawing)));
    bench.drawing = drawing(0.0, Some("mallory"));
    assert!(!bench.is_approved_by("ana"));
    assert!(bench.is_approved_by("bruno"));

    // Who approves is no better, whether the drawing stands or was moved back by somebody.
    for later in [
        drawing(2.1, Some("mallory")),
        drawing(0.0, Some("mallory")),
        drawing(2.11, Some("carla")),
    ] {
        let mut bench = new(drawing(2.1, Some("mallory")));
        bench.propose(moved(2.1), &Actor::service());
        bench.drawing = later.clone();
        assert!(!bench.is_approved_by("mallory"), "{later:?}");
        assert!(bench.is_approved_by("ana"));
    }
    // Moved back, it shows everybody how far the change goes.
    let mut bench = new(drawing(2.1, Some("mallory")));
    bench.propose(moved(2.1), &Actor::service());
    bench.drawing = drawing(0.0, None);
    assert!(!bench.is_approved_by("ana"));
    assert_eq!(bench.asks(), (2, Some(SecondApprover::Beyond)));

    // Others measure by it.
    let mut bench = new(drawing(0.0, Some("carla")));
    bench.propose(moved(0.01), &Actor::service());
    assert!(bench.is_approved_by("ana"));
    // Once something is approved, the drawing measures nothing.
    let mut bench = new(drawing(0.0, None));
    bench.prove(0.05);
    bench.drawing = drawing(2.1, Some("carla"));
    bench.propose(moved(2.1), &Actor::service());
    assert_eq!(bench.asks(), (2, Some(SecondApprover::Beyond)));
}

#[test]
fn a_refreshed_proposal_is_measured_by_the_drawing_of_now() {
    let mut bench = new(drawing(0.0, None));
    bench.propose(moved(0.01), &person("mallory"));
    assert_eq!(bench.asks(), (1, None));
    let refresh = |bench: &Bench| Command::Refresh {
        proposal: bench.ledger.open.as_ref().unwrap().id,
        values: moved(2.1),
        sigmas: CalibrationValues::default(),
        evidence: Evidence::default(),
        reason: "the estimate has moved".to_owned(),
    };
    bench.drawing = drawing(2.1, Some("mallory"));
    bench.take(refresh(&bench), &Actor::service());
    assert_eq!(bench.asks(), (2, Some(SecondApprover::OwnDrawing)));
}

#[test]
fn what_a_robot_says_of_itself_lowers_nothing() {
    let says = |bench: &mut Bench, offset_rad: f64, at_ns: i64| {
        let answer = factory(offset_rad, WallTime(at_ns));
        bench.take(Command::Acknowledge(answer), &Actor::service());
    };
    // One forged answer, next to what is proposed.
    for (drawing, why) in [
        (None, SecondApprover::Unknown),
        (drawing(0.0, None), SecondApprover::Beyond),
    ] {
        let mut bench = new(drawing);
        says(&mut bench, 0.199, 1);
        bench.do_due(&estimate(0.21, 0), false);
        assert_eq!(bench.asks(), (2, Some(why)));
    }
    let mut bench = new(drawing(0.0, None));
    bench.prove(0.05);
    says(&mut bench, 0.199, 30);
    bench.do_due(&estimate(0.21, 30), false);
    assert_eq!(bench.asks(), (2, Some(SecondApprover::Beyond)));
    // What differs from it by much is a large change for the robot, whatever was approved.
    let mut bench = new(drawing(0.0, None));
    bench.prove(0.05);
    says(&mut bench, 0.2, 30);
    bench.do_due(&estimate(0.05, 30), false);
    assert_eq!(bench.asks(), (2, Some(SecondApprover::Beyond)));
}

#[test]
fn a_return_to_what_a_robot_said_vouches_for_nothing_until_it_is_verified() {
    let mut bench = new(None);
    let answer = factory(0.2, WallTime(1));
    bench.take(Command::Acknowledge(answer), &Actor::service());
    bench.do_due(&estimate(0.05, 0), false);
    bench.approve_as("ana").unwrap();
    bench.approve_as("bruno").unwrap();
    bench.try_out();
    assert_eq!(bench.do_due(&estimate(0.2, 20), true), Some("fail"));
    bench.try_out();
    bench.do_due(&estimate(0.21, 40), false);
    assert_eq!(bench.asks(), (2, Some(SecondApprover::Unknown)));
}

#[test]
fn nothing_that_a_person_drew_is_approved_without_a_person() {
    for (by, is_automatic) in [(None, true), (Some("mallory"), false)] {
        let mut bench = new(drawing(0.0, by));
        bench.policy.approve_within = Some(Tolerance {
            steering_offset_deg: 5.0,
            lidar_yaw_deg: 5.0,
            lidar_position_mm: 50.0,
        });
        bench.do_due(&estimate(0.05, 0), false);
        let found = automatic(&bench.ledger, &bench.policy);
        assert_eq!(found.is_some(), is_automatic, "{by:?}");
    }
}

#[test]
fn a_forged_answer_hides_no_other_frame() {
    let mut bench = new(drawing(0.0, None));
    bench.prove(0.05);
    let answer = factory(0.05, WallTime(30));
    bench.take(Command::Acknowledge(answer), &Actor::service());
    bench.rear_axle = Some(Pose2::new(5.0, 0.0, 0.0));
    bench.propose(moved(0.01), &Actor::service());
    assert_eq!(bench.asks(), (2, Some(SecondApprover::Frame)));
}

#[test]
fn one_of_two_approves_once() {
    let mut bench = new(None);
    bench.propose(nominal(), &Actor::service());
    assert!(!bench.is_approved_by("ana"));
    let again = bench.approve_as("ana");
    assert_eq!(again, Err(Refused::ApprovedAlready("ana".to_owned())));
}
