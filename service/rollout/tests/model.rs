//! Roll-outs over a model of robots: which of them a roll-out touches.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::collections::BTreeSet;

use fleetcal_domain::access::{Actor, Authentication, Grant, Role};
use fleetcal_domain::approval::{DeploymentState, ProposalState};
use fleetcal_model::{DeploymentId, ProposalId, RevisionId, RobotId, RolloutId, Version, WallTime};
use fleetcal_rollout::{
    Brought, Changed, Counts, Event, Followed, Lost, Member, PlanRefused, Rollout, RolloutRefused,
    RolloutState, Stage, Take, WavePlan, due, plan_sha256, split,
};
use proptest::prelude::*;

/// Outcome of the deployment to a robot of the model, and the looks that it takes.
#[derive(Debug, Clone, Copy)]
struct Fate(DeploymentState, u32);

fn robot(number: usize) -> RobotId {
    RobotId::parse(&format!("agv_{number:02}")).unwrap()
}

fn wave(take: Take, verified_share: f64, failed_share: f64) -> WavePlan {
    WavePlan {
        take,
        verified_share,
        failed_share,
    }
}

fn ana() -> Actor {
    Actor {
        name: "ana".to_owned(),
        authentication: Authentication::Session,
        role: Some(Role::Approver),
        request: None,
    }
}

fn changed(by: &str, reason: &str) -> Changed {
    Changed {
        by: by.to_owned(),
        at_ns: WallTime(2),
        reason: Some(reason.to_owned()),
    }
}

/// Model of a fleet under one roll-out. A look takes the step that is due, or else approves what is
/// released, as the service does each second; deployments end by the fates.
struct Model {
    rollout: Rollout,
    robots: Vec<Followed>,
    fates: Vec<Fate>,
    age: Vec<u32>,
}

impl Model {
    fn new(plan: &[WavePlan], fates: Vec<Fate>) -> Self {
        let ids: Vec<_> = (0..fates.len()).map(robot).collect();
        let waves = split(plan, ids, |_, _| false).unwrap();
        let plans = waves.iter();
        let plans = plans.map(|(plan, robots)| (plan.clone(), robots.len() as u32));
        let plans = plans.collect();
        let rollout = Rollout::start(
            RolloutId(1),
            String::new(),
            plans,
            &ana(),
            None,
            WallTime(1),
        );
        let members = waves.into_iter().zip(1..).flat_map(|((_, robots), wave)| {
            robots.into_iter().map(move |robot| Member {
                proposal: ProposalId(7),
                revision: RevisionId(7),
                robot,
                wave,
            })
        });
        let followed = members.map(|member| Followed {
            proposal_state: ProposalState::Proposed,
            proposal_revision: member.revision,
            member,
            brought: None,
        });
        Self {
            rollout,
            robots: followed.collect(),
            age: vec![0; fates.len()],
            fates,
        }
    }

    /// One look: deployments go on, what is due happens, or released robots are approved.
    fn look(&mut self) {
        for ((robot, age), Fate(end, takes)) in
            self.robots.iter_mut().zip(&mut self.age).zip(&self.fates)
        {
            if let Some(brought) = &mut robot.brought {
                *age += 1;
                if *age >= *takes {
                    brought.state = *end;
                }
            }
        }
        if let Some((event, reason)) = due(&self.rollout, &self.counts()) {
            let after = self.rollout.after(&event, changed("fleetcal", &reason));
            self.rollout = after.unwrap();
            return;
        }
        let approver = Grant::of_person(Role::Approver).unwrap();
        for robot in &mut self.robots {
            let wave = robot.member.wave;
            let is_released = robot.stage(self.rollout.has_begun(wave)) == Stage::Released;
            let may = self
                .rollout
                .may_release(wave, Some((&approver, WallTime(0))));
            if is_released && may.is_ok() {
                robot.proposal_state = ProposalState::Approved;
                robot.brought = Some(Brought {
                    deployment: DeploymentId(1),
                    state: DeploymentState::Queued,
                    is_contradicted: false,
                    reason: None,
                });
            }
        }
    }

    fn run(&mut self) {
        for _ in 0..200 {
            self.look();
        }
    }

    fn counts(&self) -> Vec<Counts> {
        self.rollout.counts(&self.robots)
    }

    /// Waves of which a robot was touched.
    fn touched(&self) -> Vec<u32> {
        let touched = self.robots.iter().filter(|one| one.brought.is_some());
        let mut waves: Vec<_> = touched.map(|one| one.member.wave).collect();
        waves.dedup();
        waves
    }

    fn resume(&mut self) {
        let resume = Event::Resume(self.counts());
        let after = self.rollout.after(&resume, changed("ana", "looked at"));
        self.rollout = after.unwrap();
    }
}

/// 50 robots in waves of 10, 20 and 20; the first `failing` of the first wave end in `state`.
fn fifty(failing: usize, state: DeploymentState) -> Model {
    let plan = [
        wave(Take::Robots(10), 0.8, 0.1),
        wave(Take::Share(0.4), 0.8, 0.1),
        wave(Take::Rest, 0.8, 0.1),
    ];
    let fate = |number| {
        if number < failing {
            Fate(state, 3)
        } else {
            Fate(DeploymentState::Verified, 5)
        }
    };
    Model::new(&plan, (0..50).map(fate).collect())
}

#[test]
fn of_fifty_robots_of_which_five_fail_only_the_first_wave_is_touched() {
    for state in [
        DeploymentState::Refused,
        DeploymentState::Failed,
        DeploymentState::RollingBack,
        DeploymentState::RolledBack,
        DeploymentState::RollbackFailed,
    ] {
        let mut model = fifty(5, state);
        model.run();
        assert_eq!(model.touched(), [1], "{state:?}");
        assert_eq!(model.rollout.state, RolloutState::Halted);
        let reason = model.rollout.changed.reason.clone().unwrap();
        assert_eq!(reason, "wave 1: 5 of 10 robots have failed, 1 may");
        let waiting = model.robots.iter().filter(|one| one.member.wave > 1);
        assert!(
            waiting
                .map(|one| one.stage(false))
                .all(|stage| stage == Stage::Waiting)
        );
    }
}

#[test]
fn a_failed_verification_that_people_decide_about_halts_as_well() {
    let mut model = fifty(5, DeploymentState::Verifying);
    model.look();
    for robot in model.robots.iter_mut().take(5) {
        robot.brought.as_mut().unwrap().is_contradicted = true;
    }
    model.run();
    assert_eq!(model.touched(), [1]);
    assert_eq!(model.rollout.state, RolloutState::Halted);
}

#[test]
fn a_wave_without_failures_is_followed_by_the_next_and_the_last_by_the_end() {
    let mut model = fifty(1, DeploymentState::Refused);
    model.run();
    assert_eq!(model.touched(), [1, 2, 3]);
    assert_eq!(model.rollout.state, RolloutState::Finished);
    let verified: Vec<_> = model.counts().iter().map(|one| one.verified).collect();
    assert_eq!(verified, [9, 20, 20]);
}

#[test]
fn too_few_verified_halt_it_too_and_a_person_may_accept_that() {
    let mut model = fifty(4, DeploymentState::Inconclusive);
    model.run();
    assert_eq!(model.touched(), [1]);
    let reason = model.rollout.changed.reason.clone().unwrap();
    assert_eq!(
        reason,
        "wave 1: 0 of 10 robots are verified, 6 can still be, and 8 are needed"
    );
    model.resume();
    model.run();
    assert_eq!(model.rollout.state, RolloutState::Finished);
    assert_eq!(model.touched(), [1, 2, 3]);
}

#[test]
fn accepted_failures_do_not_halt_it_again_and_further_ones_do() {
    let mut model = fifty(5, DeploymentState::Refused);
    model.run();
    model.resume();
    model.look();
    assert_eq!(model.rollout.state, RolloutState::Running);
    model.robots[9].brought.as_mut().unwrap().state = DeploymentState::RolledBack;
    model.fates[9] = Fate(DeploymentState::RolledBack, 0);
    model.run();
    assert_eq!(model.rollout.state, RolloutState::Halted);
    assert_eq!(model.touched(), [1]);
}

#[test]
fn who_resumes_accepts_what_was_read_and_no_more() {
    let mut model = fifty(5, DeploymentState::Refused);
    model.run();
    let lost = |failed, left_out| Lost { failed, left_out };
    let check = |read: &[Lost]| model.rollout.check_read(&model.counts(), read);
    let more = Err(RolloutRefused::MoreLost {
        wave: 1,
        now: lost(5, 0),
    });
    // A failure is not what was read as left out.
    for read in [&[][..], &[lost(4, 0)], &[lost(4, 1)]] {
        assert_eq!(check(read), more, "{read:?}");
    }
    assert_eq!(check(&[lost(5, 0)]), Ok(()));
    model.rollout.state = RolloutState::Paused;
    assert_eq!(model.rollout.check_read(&model.counts(), &[]), Ok(()));
}

#[test]
fn thresholds_leave_out_what_was_accepted() {
    let mut model = fifty(5, DeploymentState::Refused);
    model.run();
    let first = &model.rollout.waves[0];
    assert_eq!((first.needed(), first.allowed()), (8, 1));
    model.resume();
    let first = &model.rollout.waves[0];
    assert_eq!((first.needed(), first.allowed()), (4, 5));
}

#[test]
fn the_hash_of_a_plan_binds_robots_and_thresholds() {
    let plan = wave(Take::Rest, 0.8, 0.1);
    let member = |number| Member {
        robot: robot(number),
        wave: 1,
        proposal: ProposalId(7),
        revision: RevisionId(7),
    };
    let all = [
        plan_sha256([&plan], &[member(1)]),
        plan_sha256([&plan], &[member(2)]),
        plan_sha256([&wave(Take::Rest, 0.7, 0.1)], &[member(1)]),
        plan_sha256([&wave(Take::Rest, 0.8, 0.2)], &[member(1)]),
        plan_sha256([&wave(Take::Robots(1), 0.8, 0.1)], &[member(1)]),
    ];
    let distinct: BTreeSet<_> = all.iter().collect();
    assert_eq!(distinct.len(), all.len());
    assert_eq!(all[0], plan_sha256([&plan], &[member(1)]));
}

#[test]
fn a_paused_roll_out_releases_nobody_and_accepts_nothing() {
    let mut model = fifty(5, DeploymentState::Refused);
    let paused = model.rollout.after(&Event::Pause, changed("ana", "lunch"));
    model.rollout = paused.unwrap();
    model.run();
    assert_eq!(model.touched(), Vec::<u32>::new());
    model.resume();
    model.run();
    assert_eq!(
        (model.touched(), model.rollout.state),
        (vec![1], RolloutState::Halted)
    );
}

#[test]
fn a_proposal_that_changed_since_is_left_out() {
    let mut model = fifty(0, DeploymentState::Refused);
    model.robots[0].proposal_revision = RevisionId(8);
    model.robots[1].proposal_state = ProposalState::Rejected;
    model.run();
    assert!(model.robots[..2].iter().all(|one| one.brought.is_none()));
    assert_eq!(model.counts()[0].left_out, 2);
    assert_eq!(model.rollout.state, RolloutState::Finished);
}

#[test]
fn every_state_admits_some_events_and_refuses_the_others() {
    use RolloutState as S;

    let events = [
        Event::Pause,
        Event::Resume(Vec::new()),
        Event::Halt,
        Event::BeginWave,
        Event::Finish,
    ];
    let table = [
        (
            S::Running,
            [
                Some(S::Paused),
                None,
                Some(S::Halted),
                Some(S::Running),
                Some(S::Finished),
            ],
        ),
        (
            S::Paused,
            [None, Some(S::Running), Some(S::Halted), None, None],
        ),
        (S::Halted, [None, Some(S::Running), None, None, None]),
        (S::Finished, [None; 5]),
    ];
    for (state, after) in table {
        for (event, after) in events.iter().zip(after) {
            assert_eq!(state.after(event).ok(), after, "{state:?} {event:?}");
        }
        assert_eq!(RolloutState::parse(state.as_str()), Some(state));
    }
    let refused = S::Finished.after(&Event::Pause).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "the roll-out is finished, and cannot be paused"
    );
}

#[test]
fn who_may_not_approve_any_more_releases_nothing() {
    let rollout = fifty(0, DeploymentState::Refused).rollout;
    let (viewer, approver) = (
        Grant::of_person(Role::Viewer).unwrap(),
        Grant::of_person(Role::Approver).unwrap(),
    );
    let gone = Err(RolloutRefused::MayNotApprove("ana".to_owned()));
    assert_eq!(rollout.may_release(1, None), gone);
    assert_eq!(rollout.may_release(1, Some((&viewer, WallTime(0)))), gone);
    // Somebody else of the same name.
    assert_eq!(rollout.may_release(1, Some((&approver, WallTime(2)))), gone);
    assert_eq!(
        rollout.may_release(1, Some((&approver, WallTime(1)))),
        Ok(())
    );
    let not_yet = Err(RolloutRefused::NotReleased);
    for wave in [0, 2, 9] {
        assert_eq!(
            rollout.may_release(wave, Some((&approver, WallTime(0)))),
            not_yet
        );
    }
}

#[test]
fn a_plan_takes_by_number_share_and_query_and_names_its_fault() {
    let ids = |count| (0..count).map(robot).collect::<Vec<_>>();
    let even = |_: &str, id: &RobotId| id.as_str().ends_with(['0', '2', '4', '6', '8']);
    let all = |take| wave(take, 1.0, 0.0);
    let plan = [
        all(Take::Robots(2)),
        all(Take::Q("tag:even".to_owned())),
        all(Take::Share(0.1)),
        all(Take::Rest),
    ];
    let sizes = |count| -> Vec<usize> {
        let waves = split(&plan, ids(count), even).unwrap();
        waves.iter().map(|(_, robots)| robots.len()).collect()
    };
    assert_eq!(sizes(30), [2, 14, 3, 11]);
    assert_eq!(sizes(2), [2]);
    let refused = |plan: &[WavePlan]| split(plan, ids(5), even).unwrap_err().to_string();
    assert_eq!(refused(&[]), "waves: got 0, expected 1 to 20");
    assert_eq!(
        refused(&[all(Take::Robots(2))]),
        "waves: 3 robots are in no wave, expected a last wave that takes the rest"
    );
    assert_eq!(
        refused(&[all(Take::Rest), wave(Take::Rest, 0.0, 0.0)]),
        "waves: wave 2 has verified_share 0, expected more than 0 and at most 1"
    );
    for wrong in [
        wave(Take::Rest, 1.0, 1.0),
        wave(Take::Rest, f64::NAN, 0.0),
        all(Take::Robots(0)),
        all(Take::Share(1.1)),
    ] {
        assert!(matches!(
            split(&[wrong], ids(5), even),
            Err(PlanRefused::Number { .. })
        ));
    }
    assert_eq!(split(&plan, Vec::new(), even), Err(PlanRefused::Nobody));
    // A tenth of 30 is 3, whatever the last bits of the product are.
    assert_eq!(
        (plan[0].needed(3), wave(Take::Rest, 0.1, 0.1).needed(30)),
        (3, 3)
    );
    assert_eq!(wave(Take::Rest, 0.1, 0.1).allowed(30), 3);
}

fn fate() -> impl Strategy<Value = Fate> {
    let states = prop::sample::select(vec![
        DeploymentState::Verified,
        DeploymentState::Verified,
        DeploymentState::Verified,
        DeploymentState::Refused,
        DeploymentState::RolledBack,
        DeploymentState::TimedOut,
        DeploymentState::Inconclusive,
    ]);
    (states, 1..20_u32).prop_map(|(state, takes)| Fate(state, takes))
}

proptest! {
    /// Whatever becomes of the robots: no wave begins while more of an earlier one have failed than
    /// may, or before enough are verified; and it always comes to an end.
    #[test]
    fn no_wave_begins_on_too_many_failures(
        fates in prop::collection::vec(fate(), 1..60),
        verified in 1..=10_u32,
        failed in 0..10_u32,
        pause_at in 0..30_usize,
    ) {
        let (verified, failed) = (f64::from(verified) / 10.0, f64::from(failed) / 10.0);
        let plan = [
            wave(Take::Robots(3), verified, failed),
            wave(Take::Share(0.3), verified, failed),
            wave(Take::Rest, verified, failed),
        ];
        let mut model = Model::new(&plan, fates);
        for look in 0..200 {
            let before = model.touched().last().copied().unwrap_or(0);
            model.look();
            if look == pause_at && model.rollout.state == RolloutState::Running {
                let paused = model.rollout.after(&Event::Pause, changed("ana", "x"));
                model.rollout = paused.unwrap();
                let touched = model.touched();
                model.look();
                prop_assert_eq!(&touched, &model.touched());
                model.resume();
            }
            let after = model.touched().last().copied().unwrap_or(0);
            let counts = model.counts();
            for (index, wave) in model.rollout.waves.iter().enumerate().take(after as usize) {
                let is_last = index + 1 == after as usize;
                if after > before && !is_last {
                    prop_assert!(counts[index].failed <= wave.plan.allowed(wave.robots));
                    prop_assert!(counts[index].verified >= wave.plan.needed(wave.robots));
                }
            }
        }
        let state = model.rollout.state;
        prop_assert!(matches!(state, RolloutState::Halted | RolloutState::Finished));
        prop_assert!(model.rollout.version > Version(1));
    }
}
