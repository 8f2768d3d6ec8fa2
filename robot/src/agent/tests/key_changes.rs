//! Changes of the service's signing key, of which a robot hears in time, late, or from a thief.

use fleetcal_model::RobotTime;
use fleetcal_proto::calibration::{AppliedStatus, Envelope};
use fleetcal_proto::key_change::{KeyChangeDocument, KeyChangeSchema};
use fleetcal_proto::signing::TrustedKeys;

use super::*;
use crate::agent::{Activation, Agent, Effect, HookAnswer, Phase, Rest};

/// Time for which the changes of these tests keep the former key, s.
const KEPT_S: i64 = 600;

fn numbered(number: u8) -> SigningKey {
    SigningKey::from_bytes(&[number; 32])
}

/// Makes a change between keys, which are numbers: [`key`] is 3.
fn change(sequence: u64, former: u8, new: u8) -> Envelope {
    stolen(sequence, former, new, former)
}

/// Makes a change that is signed with another key than the one that it ends.
fn stolen(sequence: u64, former: u8, new: u8, signer: u8) -> Envelope {
    let document = KeyChangeDocument {
        schema: KeyChangeSchema::V1,
        sequence,
        former_key: numbered(former).public_key(),
        public_key: numbered(new).public_key(),
        changed_at_ns: WallTime(0),
        former_accepted_s: KEPT_S as u32,
    };
    sign(&document, &numbered(signer)).unwrap()
}

/// Makes the answer of a service that signs with a numbered key.
fn answer_of(number: u8, generation: u64) -> Event {
    let signer = numbered(number);
    let envelope = sealed(&document(generation));
    let mut offered = wanted(&envelope, Some(question()));
    offered.envelope = envelope.signed_again(&signer);
    offered.offer = offered.offer.map(|offer| offer.signed_again(&signer));
    Event::Offered {
        offered,
        answers: Some(question()),
    }
}

fn at(seconds: i64) -> RobotTime {
    RobotTime(START_NS + seconds * SECOND_NS)
}

fn take(agent: &mut Agent, change: Envelope, seconds: i64) -> Vec<Effect> {
    follow(agent, &[change], seconds)
}

fn follow(agent: &mut Agent, changes: &[Envelope], seconds: i64) -> Vec<Effect> {
    let event = Event::KeyChanged(changes.to_vec());
    agent.step(event, at(seconds)).unwrap()
}

/// Returns true if the agent takes a document that a numbered key has signed.
fn takes(agent: &Agent, number: u8, seconds: i64) -> bool {
    let mut agent = agent.clone();
    let generation = agent.memory().highest.0 + 1;
    let effects = agent.step(answer_of(number, generation), at(seconds));
    let effects = effects.unwrap();
    effects
        .iter()
        .any(|effect| matches!(effect, Effect::AskHook(_)))
}

/// Makes an agent that holds the confirmed generation 1.
fn settled() -> Agent {
    let mut agent = Agent::new(identity(), first_memory());
    let go = Event::HookAnswered(HookAnswer::Go { before: None });
    let activated = Event::Activated(Activation::Done);
    let steps = [answer_of(3, 1), go, Event::Written(Ok(())), activated];
    for event in steps {
        agent.step(event, at(0)).unwrap();
    }
    let answer = agent.memory().held.acknowledgement().unwrap();
    let confirmed = Event::Confirmed(confirmation_of(&answer));
    agent.step(confirmed, at(0)).unwrap();
    assert_eq!(agent.memory().phase, Phase::Resting(Rest::Settled));
    agent
}

#[test]
fn both_keys_count_for_the_stated_time_and_the_new_one_alone_after_it() {
    let mut agent = settled();
    assert!(takes(&agent, 3, 1) && !takes(&agent, 5, 1));
    take(&mut agent, change(1, 3, 5), 10);
    assert_eq!(agent.memory().phase, Phase::Resting(Rest::Settled));
    assert!(takes(&agent, 3, 9 + KEPT_S) && takes(&agent, 5, 10));
    assert!(!takes(&agent, 3, 10 + KEPT_S), "a replayed old key");
    assert!(takes(&agent, 5, 10 + KEPT_S));
    // What it holds is known under either signature.
    let again = agent.step(answer_of(5, 1), at(20)).unwrap();
    assert_eq!(again, []);
}

#[test]
fn a_change_leads_forward_alone() {
    let mut agent = settled();
    take(&mut agent, change(1, 3, 5), 10);
    take(&mut agent, change(2, 5, 6), 20);
    let taken = agent.memory().keys.clone();
    let refused = [
        ("another first", change(1, 3, 9)),
        ("a number that was used", change(2, 6, 9)),
        ("one by a key that was replaced", change(3, 5, 9)),
        ("one by the first key", change(9, 3, 9)),
        ("one by a stranger", change(9, 9, 8)),
        ("one that ends another's key", stolen(9, 5, 9, 6)),
        ("one to itself", change(9, 6, 6)),
        ("a document of another kind", sealed(&document(9))),
    ];
    for (seconds, (name, envelope)) in (100..).step_by(100).zip(refused) {
        let said = take(&mut agent, envelope, seconds);
        assert!(
            matches!(said.as_slice(), [Effect::Note(_)]),
            "{name}: {said:?}"
        );
        let keys = agent.memory().keys.as_ref();
        let keys = keys.map(|ring| ring.trusted().unwrap().ids());
        let first = taken.as_ref().map(|ring| ring.trusted().unwrap().ids());
        assert!(first.unwrap().ends_with(&keys.unwrap()), "{name}");
        assert!(
            !takes(&agent, 9, seconds) && takes(&agent, 6, seconds),
            "{name}"
        );
    }
    let again = [change(1, 3, 5), change(2, 5, 6)];
    assert_eq!(follow(&mut agent, &again, 5_000), [], "all of them again");
    assert_eq!(agent.trusted().ids(), numbered(6).public_key().id());
}

#[test]
fn a_robot_that_was_away_for_several_changes_follows_them() {
    let changes = [change(1, 3, 5), change(2, 5, 6), change(3, 6, 7)];
    let mut away = settled();
    // Long after the time of each.
    let notes = follow(&mut away, &changes, 1_000_000);
    assert_eq!(notes.len(), 3, "{notes:?}");
    assert!(takes(&away, 7, 1_000_000) && takes(&away, 3, 1_000_000));
    let after = 1_000_000 + KEPT_S;
    assert!(takes(&away, 7, after) && !takes(&away, 3, after) && !takes(&away, 6, after));
    assert_eq!(follow(&mut away, &changes, after), []);
    // One in the middle follows the rest.
    let mut middle = settled();
    follow(&mut middle, &changes[..1], 10);
    assert_eq!(follow(&mut middle, &changes, 20).len(), 2);
    assert!(takes(&middle, 7, 20));
    // An instance that still has the former key announces less.
    assert_eq!(follow(&mut middle, &changes[..2], 30), []);
    // One that was given the present key has nothing to follow.
    let given = |number: u8| {
        let identity = Identity {
            trusted: numbered(number).public_key().into(),
            ..identity()
        };
        Agent::new(identity, first_memory())
    };
    assert_eq!(follow(&mut given(7), &changes, 10), []);
    // One that trusts somebody else's key follows nothing, and says so.
    let mut other = given(9);
    let said = follow(&mut other, &changes, 10);
    assert!(
        matches!(said.as_slice(), [Effect::Note(note)] if note.contains("--service-key")),
        "{said:?}"
    );
    assert!(!takes(&other, 7, 10));
}

#[test]
fn a_restart_keeps_the_keys_and_a_clock_that_was_set_back_keeps_no_key_longer() {
    let mut agent = settled();
    take(&mut agent, change(1, 3, 5), 10);
    let text = serde_json::to_string(agent.memory()).unwrap();
    let memory = || serde_json::from_str(&text).unwrap();
    let restarted = |trusted: TrustedKeys, seconds| {
        let identity = Identity {
            trusted,
            ..identity()
        };
        let mut agent = Agent::new(identity, memory());
        let event = Event::Restarted { written: false };
        agent.step(event, at(seconds)).unwrap();
        agent
    };
    let given = identity().trusted;
    let agent = restarted(given.clone(), 20);
    assert!(takes(&agent, 3, 20) && takes(&agent, 5, 20));
    assert!(!takes(&restarted(given.clone(), 700), 3, 700));
    let back = restarted(given, -90_000);
    assert!(
        !takes(&back, 3, -90_000 + KEPT_S),
        "a day earlier, for its time"
    );
    // Its owner's word is the latest.
    let other = restarted(numbered(7).public_key().into(), 20);
    assert!(takes(&other, 7, 20) && !takes(&other, 5, 20) && !takes(&other, 3, 20));
}

#[test]
fn a_robot_that_was_away_names_the_key_and_what_to_do() {
    let mut agent = settled();
    let effects = agent.step(answer_of(5, 2), at(9_000)).unwrap();
    let [Effect::Acknowledge(answer)] = effects.as_slice() else {
        panic!("{effects:?}");
    };
    assert_eq!(answer.status, AppliedStatus::Refused);
    let reason = answer.reason.as_deref().unwrap();
    let id = numbered(5).public_key().id();
    assert!(
        reason.contains(&id) && reason.contains("--service-key"),
        "{reason}"
    );
    // The next change alone does not help: it is signed with a key that the robot never knew.
    let said = take(&mut agent, change(2, 5, 6), 9_100);
    assert!(
        matches!(said.as_slice(), [Effect::Note(note)] if note.contains("--service-key")),
        "{said:?}"
    );
    assert_eq!(agent.memory().phase, Phase::Resting(Rest::Settled));
}

#[test]
fn what_is_pushed_with_an_unknown_key_leads_to_a_query_before_it_is_refused() {
    let mut agent = settled();
    let Event::Offered { offered, .. } = answer_of(5, 2) else {
        panic!("no offer");
    };
    let pushed = Event::Offered {
        offered,
        answers: None,
    };
    assert_eq!(agent.step(pushed, at(10)).unwrap(), [Effect::Pull]);
    take(&mut agent, change(1, 3, 5), 10);
    assert!(takes(&agent, 5, 10));
}
