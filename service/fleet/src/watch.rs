//! The fleet's one periodic task: rates, staleness, the end of sessions.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use fleetcal_domain::limits;
use tokio::time::MissedTickBehavior;

use crate::live::LiveUpdate;
use crate::registry::Fleet;

/// Interval of the checks of the fleet.
const LOOK_EVERY: Duration = Duration::from_millis(250);
/// Checks in a second: rates are updated, and states announced, once a second.
const LOOKS_PER_SECOND: u32 = 4;

/// Checks between two rounds of storing the robots' cross-track errors.
const LOOKS_PER_SAVE: u32 = 40;

/// Runs until the fleet stops.
pub async fn run(fleet: Arc<Fleet>) {
    let mut ticks = tokio::time::interval(LOOK_EVERY);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut looks = 0_u32;
    loop {
        tokio::select! {
            () = fleet.stop.cancelled() => {
                save_cross_tracks(&fleet);
                return;
            }
            _ = ticks.tick() => {}
        }
        looks = looks.wrapping_add(1);
        look(&fleet, looks.is_multiple_of(LOOKS_PER_SECOND));
        if looks.is_multiple_of(LOOKS_PER_SAVE) {
            save_cross_tracks(&fleet);
        }
    }
}

fn save_cross_tracks(fleet: &Fleet) {
    for robot in fleet.all() {
        fleet.save_cross_tracks(&robot);
    }
}

/// Checks every robot once.
pub fn look(fleet: &Fleet, whole_second: bool) {
    let clock = &*fleet.clock;
    if whole_second {
        share_memory(fleet);
        if fleet.previews.tick(clock.elapsed()) {
            fleet.configuration_changed();
        }
    }
    for robot in fleet.all() {
        if robot.session_just_ended(clock) {
            robot.mailbox.end_session();
        }
        if !whole_second {
            continue;
        }
        robot.tick();
        if let Some((state, stale, alive)) = robot.to_announce(clock) {
            let robot = robot.id.clone();
            fleet.announce(LiveUpdate::RobotState {
                robot,
                state,
                stale,
                alive,
            });
        }
    }
}

/// Shares the memory of all rings equally among the robots that send, and drops what is older than
/// a ring holds.
fn share_memory(fleet: &Fleet) {
    let robots = fleet.all();
    let holding = robots.iter().filter(|robot| robot.taps.ring.size() > 0);
    let all = fleet.latest_data_bytes_max.load(Ordering::Relaxed);
    let share = all / holding.count().max(1);
    let share = share.min(limits::MOMENT_BYTES_OF_ROBOT_MAX);
    let now = fleet.clock.elapsed();
    for robot in &robots {
        robot.taps.ring.tick(now, share);
    }
}
