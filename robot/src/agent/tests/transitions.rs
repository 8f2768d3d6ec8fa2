//! Every event in every phase.

use std::fmt::Write as _;

use fleetcal_model::{Generation, RobotTime};
use fleetcal_proto::calibration::{Applied, AppliedStatus, Confirmed, Envelope};
use fleetcal_proto::signing::seal;

use super::*;
use crate::agent::{Activation, Agent, Effect, Event, HookAnswer, Rest};

fn go() -> Event {
    Event::HookAnswered(HookAnswer::Go {
        before: Some("what it said".to_owned()),
    })
}

/// Makes the robot's acknowledgement of a generation, `seconds` after the start of its agent.
fn said(generation: u64, status: AppliedStatus, seconds: i64) -> Applied {
    Applied {
        generation: Generation(generation),
        sha256: sealed(&document(generation)).sha256,
        status,
        reason: None,
        applied_at_ns: RobotTime(START_NS + seconds * SECOND_NS),
        values: None,
    }
}

fn confirmed(generation: u64, status: AppliedStatus, seconds: i64) -> Event {
    Event::Confirmed(confirmation_of(&said(generation, status, seconds)))
}

/// Makes the confirmation of the acknowledgements of [`agents`] that have applied 3, and 4 after
/// that.
fn confirmation(generation: u64) -> Event {
    let seconds = if generation == 3 { 4 } else { 9 };
    confirmed(generation, AppliedStatus::Applied, seconds)
}

fn offered(generation: u64) -> Event {
    answered(&sealed(&document(generation)))
}

fn pushed(generation: u64) -> Event {
    Event::Offered {
        offered: wanted(&sealed(&document(generation)), None),
        answers: None,
    }
}

/// Makes a recorded answer to somebody else's question: the document is genuine, and so was the
/// answer.
fn recorded(generation: u64) -> Event {
    let earlier = Question::from_bytes([1; QUESTION_BYTES]);
    Event::Offered {
        offered: wanted(&sealed(&document(generation)), Some(earlier)),
        answers: Some(question()),
    }
}

/// Makes an answer of generation 6 with this offer beside it.
fn beside(offer: Option<Envelope>) -> Event {
    Event::Offered {
        offered: Offered {
            envelope: sealed(&document(6)),
            offer,
        },
        answers: Some(question()),
    }
}

/// Returns the agent after these events, a second apart.
fn after(events: &[Event]) -> (Agent, i64) {
    let mut agent = Agent::new(identity(), first_memory());
    let mut now = START_NS;
    agent
        .step(Event::Restarted { written: false }, RobotTime(now))
        .unwrap();
    for event in events {
        now += SECOND_NS;
        agent.step(event.clone(), RobotTime(now)).unwrap();
    }
    (agent, now)
}

/// Makes an agent of each kind, with the name of its history. All hold or handle generation 3 or 4.
fn agents() -> Vec<(&'static str, Vec<Event>)> {
    let apply = |generation| {
        [
            offered(generation),
            go(),
            Event::Written(Ok(())),
            Event::Activated(Activation::Done),
        ]
    };
    let settled = [&apply(3)[..], &[confirmation(3)]].concat();
    let unconfirmed = [&settled[..], &apply(4)].concat();
    let with = |events: &[Event], more: &[Event]| [events, more].concat();
    let given_up = Event::Written(Err("disk is full".to_owned()));
    vec![
        ("new", Vec::new()),
        ("holding 3", settled.clone()),
        ("asking for 4", with(&settled, &[offered(4)])),
        ("writing 4", with(&settled, &[offered(4), go()])),
        ("unconfirmed 4", unconfirmed.clone()),
        (
            "activating 4",
            with(&settled, &[offered(4), go(), Event::Written(Ok(()))]),
        ),
        (
            "unconfirmed 4, asking for 5",
            with(&unconfirmed, &[offered(5)]),
        ),
        (
            "unconfirmed 4, writing 5",
            with(&unconfirmed, &[offered(5), go()]),
        ),
        (
            "unconfirmed 4, activating 5",
            with(&unconfirmed, &[offered(5), go(), Event::Written(Ok(()))]),
        ),
        (
            "unconfirmed 4, restoring it after 5 failed",
            with(&unconfirmed, &[offered(5), go(), given_up.clone()]),
        ),
        (
            "restoring 3 after 4 failed",
            with(&settled, &[offered(4), go(), given_up.clone()]),
        ),
        (
            "holding 3 after 4 failed",
            with(
                &settled,
                &[
                    offered(4),
                    go(),
                    given_up,
                    Event::Restored(Ok(())),
                    Event::RevertTold(Ok(())),
                ],
            ),
        ),
    ]
}

fn ended_offer() -> Envelope {
    let offer = wanted(&sealed(&document(6)), Some(question()))
        .offer
        .unwrap();
    let mut offer: OfferDocument = offer.open_as(&identity().trusted).unwrap();
    offer.valid_until_ns = offer.offered_at_ns;
    sign(&offer, &key()).unwrap()
}

#[expect(clippy::too_many_lines, reason = "one line for each event")]
fn events() -> Vec<(&'static str, Event)> {
    let altered = |generation| {
        let envelope = sealed(&document(generation));
        let document = envelope.document.replace("\"ana\"", "\"eve\"");
        answered(&Envelope {
            document,
            ..envelope
        })
    };
    let mut beyond = document(6);
    beyond.values.steering_offset_rad = 0.3;
    let mut stale_base = document(6);
    stale_base.base_generation = Some(Generation(2));
    let mut hasty = document(6);
    hasty.confirm_within_s = 0;
    let mut other_robot = document(6);
    other_robot.robot = RobotId::parse("tugger_02").unwrap();
    let mut other_four = document(4);
    other_four.approved_by = "bob".to_owned();
    vec![
        ("restarted", Event::Restarted { written: false }),
        ("restarted, written", Event::Restarted { written: true }),
        ("offered 6", offered(6)),
        ("offered 4", offered(4)),
        ("offered 3", offered(3)),
        ("offered 2", offered(2)),
        ("offered another 4", answered(&sealed(&other_four))),
        ("offered 6 altered", altered(6)),
        ("offered 3 altered", altered(3)),
        (
            "offered 6 by a stranger",
            answered(&seal(&document(6), &strange_key()).unwrap()),
        ),
        ("offered 6 beyond limits", answered(&sealed(&beyond))),
        ("offered 6 on base 2", answered(&sealed(&stale_base))),
        ("offered 6 for 0 s", answered(&sealed(&hasty))),
        ("offered 6 of another", answered(&sealed(&other_robot))),
        ("pushed 6", pushed(6)),
        ("pushed 4", pushed(4)),
        ("pushed 2", pushed(2)),
        ("recorded 6", recorded(6)),
        ("offered 6, no offer", beside(None)),
        (
            "offered 6, offer of 7",
            beside(wanted(&sealed(&document(7)), Some(question())).offer),
        ),
        ("offered 6, ended", beside(Some(ended_offer()))),
        ("confirmed 3", confirmation(3)),
        ("confirmed 4", confirmation(4)),
        ("confirmed 5", confirmation(5)),
        (
            "confirmed 4, refused",
            confirmed(4, AppliedStatus::Refused, 9),
        ),
        (
            "confirmed 4, earlier",
            confirmed(4, AppliedStatus::Applied, 8),
        ),
        (
            "confirmed 4, unsigned",
            Event::Confirmed(Confirmed {
                signed: None,
                ..confirmation_of(&said(4, AppliedStatus::Applied, 9))
            }),
        ),
        ("service up", Event::ServiceUp),
        ("tick", Event::Tick),
        ("tick after 6 s", Event::Tick),
        ("tick after 601 s", Event::Tick),
        ("hook: go", go()),
        ("hook: busy", Event::HookAnswered(HookAnswer::Busy)),
        (
            "hook: failed",
            Event::HookAnswered(HookAnswer::Failed("no".to_owned())),
        ),
        ("written", Event::Written(Ok(()))),
        (
            "not written",
            Event::Written(Err("disk is full".to_owned())),
        ),
        ("activated", Event::Activated(Activation::Done)),
        ("activated: busy", Event::Activated(Activation::Busy)),
        (
            "not activated",
            Event::Activated(Activation::Failed("no".to_owned())),
        ),
        ("told of the way back", Event::RevertTold(Ok(()))),
        (
            "not told",
            Event::RevertTold(Err("hook ended with 1".to_owned())),
        ),
        ("restored", Event::Restored(Ok(()))),
        (
            "not restored",
            Event::Restored(Err("disk is full".to_owned())),
        ),
    ]
}

fn in_words(effect: &Effect) -> String {
    match effect {
        Effect::AskHook(offer) => format!("ask for {}", offer.generation),
        Effect::Write(values) => format!("write {}", (values.steering_offset_rad * 1e3).round()),
        Effect::Activate(offer) => format!("activate {}", offer.generation),
        Effect::Restore(fallback) => format!("restore {}", fallback.held.generation),
        Effect::TellReverted(ending) => format!("tell of {}", ending.generation),
        Effect::Acknowledge(Applied {
            generation,
            status,
            reason,
            ..
        }) => {
            // Hashes and key ids say nothing to a reader.
            let is_hash = |word: &&str| {
                let word = word.trim_matches(['"', ',']);
                word.len() >= 16 && word.chars().all(|c| c.is_ascii_hexdigit())
            };
            let reason = reason.as_deref().map_or(String::new(), |reason| {
                let words: Vec<_> = reason.split(' ').filter(|word| !is_hash(word)).collect();
                format!(" ({})", words.join(" "))
            });
            format!("answer {generation} {status:?}{reason}")
        }
        Effect::AskConfirmed => "ask what is stored".to_owned(),
        Effect::Pull => "pull".to_owned(),
        Effect::Note(_) => "note".to_owned(),
    }
}

fn table() -> String {
    let mut table = String::new();
    for (went_through, history) in agents() {
        let (agent, now) = after(&history);
        writeln!(table, "{went_through}").unwrap();
        for (name, event) in events() {
            let later_s = match name {
                "tick after 6 s" => 6,
                "tick after 601 s" => 601,
                _ => 1,
            };
            let mut agent = agent.clone();
            let before = agent.memory().clone();
            let result = agent.step(event, RobotTime(now + later_s * SECOND_NS));
            let memory = agent.memory();
            let outcome = match result {
                Ok(effects) => effects.iter().map(in_words).collect::<Vec<_>>().join(", "),
                Err(error) => {
                    assert_eq!(*memory, before, "a refused transition changes nothing");
                    format!("REFUSED: {error}")
                }
            };
            let firmly = match memory.phase.clone().rest_mut() {
                Rest::Settled => "",
                Rest::Unconfirmed(_) => "?",
            };
            let line = format!(
                "  {name:<24} → {}{firmly} {}: {outcome}",
                memory.held.generation,
                memory.phase.name()
            );
            writeln!(table, "{}", line.trim_end_matches([' ', ':'])).unwrap();
        }
    }
    table
}

/// Compares the table, whose lines have: the event → the generation held (`?`: not confirmed), the
/// phase, the effects.
#[test]
fn every_event_in_every_phase_does_what_the_table_says() {
    insta::assert_snapshot!("table", table());
}
