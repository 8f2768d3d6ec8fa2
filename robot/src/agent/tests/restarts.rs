//! The agent that was killed, and what the next one makes of what it left on the disk.

use std::fs;

use fleetcal_model::{Generation, RobotTime};
use fleetcal_patience::until;
use fleetcal_proto::calibration::AppliedStatus;

use super::service::{Service, free_endpoint};
use super::wire::{BY_HAND, Robot, text_of};
use super::*;
use crate::agent::{Ending, Fallback, Offer, Outcome, Phase, Rest, Trial};

fn offer(generation: u64) -> Offer {
    let envelope = sealed(&document(generation));
    Offer {
        generation: Generation(generation),
        sha256: envelope.sha256,
        ends_ns: RobotTime(START_NS).plus(WANTED_FOR),
        confirm_within_s: 600,
        values: values(generation),
        rear_axle_in_base_link: None,
        steering_table: None,
        document: envelope.document,
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_was_written_when_the_agent_was_killed_is_acknowledged_by_the_next() {
    let service = Service::start().await;
    let mut robot = Robot::new(&service.endpoint).with_hook();
    let writing = Phase::Writing {
        offer: offer(1),
        rest: Rest::Settled,
        before: Some(BY_HAND.to_owned()),
    };
    let memory = Memory {
        phase: writing,
        ..first_memory()
    };
    robot.remember(&memory);
    fs::write(&robot.options.apply, text_of(1)).unwrap();
    robot.start();
    service.wait_for(1, AppliedStatus::Applied).await;
    assert_eq!(robot.stop().await, 1);
    assert_eq!(robot.calls(), ["applied 1"], "the hook had agreed before");

    // Killed before the file was replaced: the document comes again, and so does the question.
    let mut robot = Robot::new(&service.endpoint).with_hook();
    robot.remember(&memory);
    fs::write(&robot.options.apply, BY_HAND).unwrap();
    service.store(&sealed(&document(1)));
    robot.start();
    until("it is in use", || {
        robot.memory().held.generation == Generation(1)
    })
    .await;
    assert_eq!(robot.file(), text_of(1));
    assert_eq!(robot.stop().await, 1);
    assert_eq!(robot.calls(), ["check 1", "applied 1"]);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_deadline_survives_a_restart_without_any_service() {
    let mut robot = Robot::new(&free_endpoint()).with_hook();
    let held = Held {
        generation: Generation(1),
        sha256: offer(1).sha256,
        applied_at_ns: RobotTime(START_NS),
        values: Some(values(1)),
        rear_axle_in_base_link: None,
        steering_table: None,
    };
    let trial = Trial {
        until_ns: RobotTime(START_NS + SECOND_NS),
        confirm_within_s: 600,
        put_off: true,
        document: offer(1).document,
        fallback: Fallback {
            held: Held::factory(None, RobotTime(START_NS)),
            file: None,
        },
    };
    let memory = Memory {
        held,
        phase: Phase::Resting(Rest::Unconfirmed(trial)),
        highest: Generation(1),
        ..first_memory()
    };
    robot.remember(&memory);
    fs::write(&robot.options.apply, text_of(1)).unwrap();
    robot.start();
    until("it goes back", || !robot.options.apply.exists()).await;
    robot.settles().await;
    assert_eq!(robot.calls(), ["reverted 1"]);
    assert_eq!(robot.stop().await, 0);

    // Killed on its way back it goes on there.
    let ending = Ending {
        generation: Generation(1),
        sha256: offer(1).sha256,
        outcome: Outcome::Answered {
            status: AppliedStatus::Reverted,
            reason: "no confirmation within 600 s".to_owned(),
        },
        document: offer(1).document,
    };
    let restoring = Phase::Restoring {
        fallback: Fallback {
            held: Held::factory(None, RobotTime(START_NS)),
            file: Some(BY_HAND.to_owned()),
        },
        rest: Rest::Settled,
        ending,
    };
    fs::write(&robot.options.apply, text_of(1)).unwrap();
    robot.remember(&Memory {
        phase: restoring,
        ..memory
    });
    robot.start();
    robot.settles().await;
    assert_eq!(robot.file(), BY_HAND);
    assert_eq!(robot.stop().await, 0);
}
