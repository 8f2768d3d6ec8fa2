//! Plan of a roll-out: its robots and waves, as the fleet is at this moment.

use std::collections::BTreeMap;

use axum::http::StatusCode;
use fleetcal_documents::{LeftOutDocument, PlanDocument, PlannedRobot, PlannedWave};
use fleetcal_domain::limits;
use fleetcal_model::{ProposalId, RobotId, RolloutId};
use fleetcal_rollout::{Member, PlanRefused, RolloutState, Take, WavePlan, plan_sha256, split};
use fleetcal_store::{RolloutFilter, StoreError};
use fleetcal_view::Query;

use crate::ApiState;
use crate::access::Caller;
use crate::problem::Problem;
use crate::robots::{in_view, query_of};

/// Plan with what the caller would approve.
pub(super) struct Plan {
    pub(super) document: PlanDocument,
    pub(super) members: Vec<Member>,
}

/// Plans a roll-out of the pending proposals that a query selects.
pub(super) async fn plan(
    api: &ApiState,
    caller: &Caller,
    q: Option<&str>,
    waves: &[WavePlan],
) -> Result<Plan, Problem> {
    let (query, name) = (query_of(q)?, &*caller.actor.name);
    let queries = queries(waves)?;
    let taken = in_other_rollouts(api).await?;
    let mut robots = BTreeMap::new();
    let mut planned = BTreeMap::new();
    let mut left_out = Vec::new();
    for robot in in_view(api, &query, api.clock.now()) {
        let Some(open) = &robot.ledger.open else {
            continue;
        };
        let present = api.lifecycle.present(&open.robot);
        let other = taken.get(&open.id).copied();
        if let Some(one) = LeftOutDocument::of(&robot.ledger, &present, (name, other)) {
            left_out.push(one);
            continue;
        }
        let one = PlannedRobot {
            robot: open.robot.clone(),
            proposal: open.id,
            revision: open.revision,
            second_approver: open.approvals_needed as usize > open.approvals.len() + 1,
        };
        planned.insert(open.robot.clone(), one);
        robots.insert(open.robot.clone(), robot);
    }
    let selects = |q: &str, id: &RobotId| {
        let (query, robot) = (queries.get(q), robots.get(id));
        query.is_some_and(|query| robot.is_some_and(|one| query.selects(&one.properties())))
    };
    let split =
        split(waves, robots.keys().cloned().collect(), selects).map_err(|wrong| refused(&wrong))?;
    let member = |one: &PlannedRobot, wave| Member {
        robot: one.robot.clone(),
        wave,
        proposal: one.proposal,
        revision: one.revision,
    };
    let mut members = Vec::new();
    let mut waves = Vec::new();
    for ((plan, ids), wave) in split.into_iter().zip(1..) {
        let count = ids.len() as u32;
        let robots: Vec<_> = ids.iter().filter_map(|id| planned.remove(id)).collect();
        members.extend(robots.iter().map(|one| member(one, wave)));
        waves.push(PlannedWave {
            needed: plan.needed(count),
            allowed: plan.allowed(count),
            plan,
            robots,
        });
    }
    let document = PlanDocument {
        q: query.to_string(),
        sha256: plan_sha256(waves.iter().map(|wave| &wave.plan), &members),
        waves,
        left_out,
    };
    Ok(Plan { document, members })
}

/// Queries of the waves, by their texts.
fn queries(waves: &[WavePlan]) -> Result<BTreeMap<&str, Query>, Problem> {
    let texts = waves.iter().filter_map(|wave| match &wave.take {
        Take::Q(q) => Some(q.as_str()),
        Take::Robots(_) | Take::Share(_) | Take::Rest => None,
    });
    texts
        .map(|text| Ok((text, query_of(Some(text))?)))
        .collect()
}

/// Proposals of the roll-outs that go on, with their numbers.
async fn in_other_rollouts(api: &ApiState) -> Result<BTreeMap<ProposalId, RolloutId>, StoreError> {
    let mut taken = BTreeMap::new();
    for state in [RolloutState::Running, RolloutState::Paused] {
        let filter = RolloutFilter {
            state: Some(state),
            before: None,
            limit: limits::ROLLOUTS_RUNNING_MAX,
        };
        for rollout in api.store.rollouts(&filter).await? {
            let robots = api.store.rollout_robots(rollout.id).await?;
            let proposals = robots.iter().map(|one| (one.member.proposal, rollout.id));
            taken.extend(proposals);
        }
    }
    Ok(taken)
}

fn refused(refused: &PlanRefused) -> Problem {
    let field = match refused {
        PlanRefused::Nobody => "q",
        PlanRefused::Count { .. } | PlanRefused::Number { .. } | PlanRefused::LeftOver { .. } => {
            "waves"
        }
    };
    let status = StatusCode::BAD_REQUEST;
    Problem::new(status, "value_refused", refused.to_string()).of_field(field)
}
