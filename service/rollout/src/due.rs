//! Event that the counts of its waves make due for a running roll-out.

use crate::member::Counts;
use crate::rollout::{Event, Rollout, RolloutState, Wave};

/// Event that is due, if any, with its reason; `counts` are those of [`Rollout::counts`]. Each
/// changes the roll-out, so that it is due once. In this order:
///
/// 1. halt, when more robots of a wave have failed than may, beyond those that a person accepted,
/// 2. begin of the next wave, when enough robots of the last begun one are verified,
/// 3. halt, when not enough of them can be verified any more; robots that a person accepted as lost
///    count for neither,
/// 4. end, when every robot of the last wave has an outcome.
pub fn due(rollout: &Rollout, counts: &[Counts]) -> Option<(Event, String)> {
    if rollout.state != RolloutState::Running {
        return None;
    }
    let begun = rollout.waves.iter().zip(counts).zip(1..);
    let begun = begun.take_while(|((wave, _), _)| wave.begun_ns.is_some());
    let begun: Vec<((&Wave, &Counts), usize)> = begun.collect();
    let failing = begun.iter().find_map(|((wave, counts), number)| {
        let (failed, robots, allowed) = (counts.failed, wave.robots, wave.allowed());
        (failed > allowed).then(|| {
            format!("wave {number}: {failed} of {robots} robots have failed, {allowed} may")
        })
    });
    if let Some(reason) = failing {
        return Some((Event::Halt, reason));
    }
    let &((wave, counts), number) = begun.last()?;
    if number == rollout.waves.len() {
        let is_over = begun.iter().all(|((_, counts), _)| counts.open() == 0);
        return is_over.then(|| (Event::Finish, "every robot has an outcome".to_owned()));
    }
    let (verified, robots, needed) = (counts.verified, wave.robots, wave.needed());
    let reason = format!("wave {number}: {verified} of {robots} robots are verified");
    if verified >= needed {
        return Some((Event::BeginWave, reason));
    }
    let open = counts.open();
    let is_out_of_reach = verified + open < needed;
    is_out_of_reach.then(|| {
        let reason = format!("{reason}, {open} can still be, and {needed} are needed");
        (Event::Halt, reason)
    })
}
