//! Recorded documents, answers of others in the robot's name, and words in the service's.

use fleetcal_model::RobotTime;
use fleetcal_proto::calibration::{Applied, AppliedStatus, Confirmed};

use super::*;
use crate::agent::{Activation, Agent, Effect, HookAnswer, Phase, Rest};

fn go() -> Event {
    Event::HookAnswered(HookAnswer::Go { before: None })
}

/// Makes an agent that has just brought generation 4 into use, with its acknowledgement.
fn in_use() -> (Agent, Applied) {
    let mut agent = Agent::new(identity(), first_memory());
    let activated = Event::Activated(Activation::Done);
    let offered = answered(&sealed(&document(4)));
    let mut effects = Vec::new();
    for event in [offered, go(), Event::Written(Ok(())), activated] {
        effects = agent.step(event, RobotTime(START_NS)).unwrap();
    }
    let said = effects.into_iter().find_map(|effect| match effect {
        Effect::Acknowledge(applied) => Some(applied),
        _ => None,
    });
    (agent, said.unwrap())
}

fn is_settled(agent: &Agent) -> bool {
    agent.memory().phase == Phase::Resting(Rest::Settled)
}

fn asks_hook(effects: &[Effect]) -> bool {
    effects
        .iter()
        .any(|effect| matches!(effect, Effect::AskHook(_)))
}

#[test]
fn the_confirmation_of_another_answer_settles_nothing() {
    let (agent, said) = in_use();
    assert_eq!(said.status, AppliedStatus::Applied);
    // Another computer with an agent of this robot, or anybody in its name.
    let refused = Applied {
        status: AppliedStatus::Refused,
        ..said.clone()
    };
    let of_another = Applied {
        applied_at_ns: RobotTime(said.applied_at_ns.0 + 1),
        ..said.clone()
    };
    let altered = |change: fn(&mut Confirmed)| {
        let mut confirmed = confirmation_of(&said);
        change(&mut confirmed);
        confirmed
    };
    let not_believed = [
        confirmation_of(&refused),
        confirmation_of(&of_another),
        altered(|one| one.signed = None),
        altered(|one| one.signed = Some(sealed(&document(4)))),
        Confirmed {
            signed: sign(&ConfirmationDocument::of(robot(), &said), &strange_key()).ok(),
            ..confirmation_of(&said)
        },
        Confirmed {
            signed: sign(
                &ConfirmationDocument::of(RobotId::parse("tugger_02").unwrap(), &said),
                &key(),
            )
            .ok(),
            ..confirmation_of(&said)
        },
    ];
    for confirmed in not_believed {
        let mut agent = agent.clone();
        let event = Event::Confirmed(confirmed.clone());
        agent.step(event, RobotTime(START_NS)).unwrap();
        assert!(!is_settled(&agent), "settled by {confirmed:?}");
        assert_eq!(agent.memory().unstored, std::slice::from_ref(&said));
        let later = RobotTime(START_NS + 601 * SECOND_NS);
        let effects = agent.step(Event::Tick, later).unwrap();
        assert!(matches!(effects.as_slice(), [Effect::Restore(_)]));
    }
    let mut agent = agent;
    let event = Event::Confirmed(confirmation_of(&said));
    assert_eq!(agent.step(event, RobotTime(START_NS)).unwrap(), []);
    assert!(is_settled(&agent) && agent.memory().unstored.is_empty());
}

#[test]
fn a_recorded_document_is_not_applied_whatever_the_clock_says() {
    for now in [RobotTime(0), RobotTime(START_NS), RobotTime(i64::MAX / 2)] {
        let mut agent = Agent::new(identity(), first_memory());
        let envelope = sealed(&document(4));
        let earlier = Question::from_bytes([1; QUESTION_BYTES]);
        let recorded = Event::Offered {
            offered: wanted(&envelope, Some(earlier)),
            answers: Some(question()),
        };
        let effects = agent.step(recorded, now).unwrap();
        assert!(!asks_hook(&effects), "{effects:?}");
        let [Effect::Acknowledge(refused)] = effects.as_slice() else {
            panic!("{effects:?}");
        };
        let reason = refused.reason.clone().unwrap();
        assert!(reason.contains("a recording"), "{reason}");
        // It leaves no trace: the service itself still says what it wants.
        let effects = agent.step(answered(&envelope), now).unwrap();
        assert!(asks_hook(&effects), "{effects:?}");
    }
}

#[test]
fn what_is_pushed_makes_the_agent_ask_and_a_flood_of_it_once_a_second() {
    let mut agent = Agent::new(identity(), first_memory());
    let pushed = || Event::Offered {
        offered: wanted(&sealed(&document(4)), None),
        answers: None,
    };
    let at = |ms: i64| RobotTime(START_NS + ms * 1_000_000);
    assert_eq!(agent.step(pushed(), at(0)).unwrap(), [Effect::Pull]);
    for ms in [1, 500, 999] {
        assert_eq!(agent.step(pushed(), at(ms)).unwrap(), []);
        assert_eq!(agent.step(Event::Tick, at(ms)).unwrap(), []);
    }
    // The last one is not forgotten.
    assert_eq!(agent.step(Event::Tick, at(1000)).unwrap(), [Effect::Pull]);
    assert_eq!(agent.step(Event::Tick, at(1200)).unwrap(), []);
}

#[test]
fn an_offer_that_ended_while_the_hook_was_asked_is_asked_for_again() {
    let mut agent = Agent::new(identity(), first_memory());
    let now = RobotTime(START_NS);
    assert!(asks_hook(
        &agent.step(answered(&sealed(&document(4))), now).unwrap()
    ));
    let effects = agent.step(go(), now.plus(WANTED_FOR)).unwrap();
    assert!(
        matches!(effects.as_slice(), [Effect::Note(_), Effect::Pull]),
        "{effects:?}"
    );
    assert!(is_settled(&agent) && agent.memory().latest.is_none());
}

/// Checks that the end of an offer only refuses new documents: the settled calibration stays in
/// use, however long the service is unreachable.
#[test]
fn a_robot_without_a_service_drives_on_for_years() {
    let (mut agent, said) = in_use();
    let event = Event::Confirmed(confirmation_of(&said));
    agent.step(event, RobotTime(START_NS)).unwrap();
    let years_later = RobotTime(START_NS).plus(Duration::from_hours(24 * 3_650));
    assert_eq!(agent.step(Event::Tick, years_later).unwrap(), []);
    let restarted = Event::Restarted { written: false };
    agent.step(restarted, years_later).unwrap();
    assert!(is_settled(&agent));
    assert_eq!(agent.memory().held.generation, Generation(4));
}
