//! Calibrations that a person takes back before the robot has applied them.

use crate::access::Actor;
use crate::approval::{Command, DeploymentState};

use super::bench::{Bench, estimate, person};

#[test]
fn a_first_calibration_that_was_offered_is_taken_back_and_nothing_is_desired() {
    let mut bench = Bench::new();
    // Nobody knows what the robot uses: there is no way back to it.
    bench.drawing = None;
    let found = estimate(0.02, 0);
    assert_eq!(bench.do_due(&found, false), Some("propose"));
    for name in ["ana", "bruno"] {
        bench.approve_as(name).unwrap();
    }
    let offer = bench.ledger.live.clone().unwrap().offer;
    let generation = offer.generation;
    bench.take(Command::Offer { generation }, &Actor::service());
    assert_eq!(bench.state(), Some(DeploymentState::Offered));

    let back = Command::RollBack {
        version: None,
        reason: "the bracket is bent".to_owned(),
    };
    bench.take(back, &person("cem"));
    assert_eq!((bench.state(), &bench.ledger.shadow.desired), (None, &None));
    // What a person took back the service does not propose again by itself.
    assert_eq!(bench.ledger.shadow.declined, Some(offer.revision));
    assert_eq!(bench.due(Some(&found), false), None);
}
