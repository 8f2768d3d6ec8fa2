//! Everything that can be read, as text.

use std::fmt::Write as _;

use fleetcal_contract::NOW_S;
use fleetcal_domain::access::SecretHash;
use fleetcal_domain::alert::ConditionName;
use fleetcal_domain::approval::ProposalState;
use fleetcal_model::{
    AlertId, AuditId, DeploymentId, Generation, Parameter, ProposalId, RolloutId, UserId, WallTime,
    WebhookId,
};
use fleetcal_rollout::RolloutState;
use fleetcal_store::backend::Stretch;
use fleetcal_store::{
    AlertFilter, AlertSelection, AuditFilter, CertificateFilter, HistoryQuery, ProposalFilter,
    RolloutFilter, Store,
};

use super::chance::robots;
use super::methods::Calls;

/// Limit above the size of any sequence's records.
const MANY: u32 = 10_000;
/// Numbers that a sequence may assign, and some that it does not.
const NUMBERS: std::ops::Range<u64> = 0..9;

/// Export in progress.
struct Export<'s> {
    store: &'s Store,
    calls: &'s Calls,
    text: String,
}

/// Calls a method of the store, records its name, and keeps the answer.
macro_rules! ask {
    ($export:expr, $name:literal, $method:ident ( $($argument:expr),* )) => {{
        let answer = $export.store.$method($($argument),*).await.unwrap();
        $export.calls.note(concat!("reader.", $name));
        writeln!($export.text, concat!($name, ": {:?}"), answer).unwrap();
        answer
    }};
}

/// Rounds means, whose last bit depends on the order of summation, to 13 digits.
fn round_means(stretch: &mut Stretch) {
    let round = |value: &mut f64| *value = format!("{value:.12e}").parse().unwrap();
    stretch.nis.iter_mut().for_each(round);
    for cell in stretch.cells.iter_mut().flatten() {
        round(&mut cell.mean);
        round(&mut cell.sigma);
    }
}

/// Exports everything that the store's reading methods return.
pub async fn everything(store: &Store, calls: &Calls) -> String {
    let mut export = Export {
        store,
        calls,
        text: String::new(),
    };
    export.accounts().await;
    export.robots().await;
    export.history().await;
    export.approvals().await;
    export.certificates().await;
    export.rollouts().await;
    export.audit().await;
    export.alerts().await;
    export.webhooks().await;
    export.text
}

impl Export<'_> {
    async fn accounts(&mut self) {
        ask!(self, "users", users(0, MANY));
        ask!(self, "users", users(2, 1));
        ask!(self, "users", has_users());
        ask!(self, "tokens", tokens(0, MANY));
        ask!(self, "tokens", tokens(1, 2));
        for name in ["ann", "ANN", "Bob B.", "ZO\u{eb}", "nobody", ""] {
            ask!(self, "user_named", user_named(name));
        }
        for number in NUMBERS {
            ask!(self, "user", user(UserId(number as i64)));
            let hash = SecretHash::of(&number.to_string());
            ask!(self, "token_of", token_of(hash));
            ask!(self, "session_of", session_of(hash));
            ask!(self, "setup_code", setup_code(hash));
        }
    }

    async fn robots(&mut self) {
        ask!(self, "robots", load_robots());
        ask!(self, "current", load_current());
        ask!(self, "checkpoints", load_checkpoints());
        ask!(self, "cross_tracks", load_cross_tracks());
        let some: Vec<_> = robots().skip(1).collect();
        ask!(self, "checkpoints_of", load_checkpoints_of(&some));
        ask!(self, "checkpoints_of", load_checkpoints_of(&[]));
        for robot in robots() {
            ask!(self, "robot", load_robot(&robot));
            ask!(self, "last_second", last_second(&robot));
            ask!(self, "events", events(&robot, None, MANY));
            ask!(self, "events", events(&robot, Some(5), 2));
        }
        // Each database counts its own migrations.
        let (found, known) = self.store.schema().await.unwrap();
        self.calls.note("reader.schema_version");
        assert_eq!(found, known);
        // A server without a synchronous standby, as a file, does not outlive its machine.
        ask!(self, "survives_machine_loss", survives_machine_loss());
    }

    async fn history(&mut self) {
        for robot in robots() {
            // In seconds, minutes and hours, wholly and in part.
            for (from_s, to_s, points_max) in [
                (0, 7_200, 7_200),
                (61, 3_661, 60),
                (0, 7_200, 2),
                (0, 7_200, 130),
            ] {
                let query = HistoryQuery {
                    robot: robot.clone(),
                    parameters: Parameter::ALL.to_vec(),
                    from_s: NOW_S + from_s,
                    to_s: NOW_S + to_s,
                    points_max,
                };
                let mut history = self.store.history(&query).await.unwrap();
                history.stretches.iter_mut().for_each(round_means);
                writeln!(self.text, "history: {history:?}").unwrap();
                self.calls.note("reader.stretches");
                self.calls.note("reader.extent");
            }
        }
    }

    async fn approvals(&mut self) {
        ask!(self, "ledgers", load_ledgers());
        ask!(self, "outbox", outbox());
        ask!(self, "deployment_freeze", deployment_freeze());
        ask!(self, "policy", stored_policy());
        let ids: Vec<ProposalId> = NUMBERS.map(ProposalId).collect();
        ask!(self, "followed", followed(&ids));
        ask!(self, "followed", followed(&[]));
        for id in ids {
            ask!(self, "proposal", proposal(id));
        }
        let all = ProposalFilter {
            limit: MANY,
            ..ProposalFilter::default()
        };
        ask!(self, "proposals", proposals(&all));
        for &state in ProposalState::ALL {
            let state = Some(state);
            ask!(
                self,
                "proposals",
                proposals(&ProposalFilter {
                    state,
                    ..all.clone()
                })
            );
        }
        for robot in robots() {
            let of_robot = ProposalFilter {
                robot: Some(robot.clone()),
                before: Some(4),
                limit: 2,
                ..ProposalFilter::default()
            };
            ask!(self, "proposals", proposals(&of_robot));
            ask!(self, "deployments", deployments(&robot, None, MANY));
            ask!(self, "deployments", deployments(&robot, Some(3), 1));
            for generation in NUMBERS {
                ask!(self, "envelope", envelope(&robot, Generation(generation)));
            }
        }
    }

    async fn rollouts(&mut self) {
        for state in RolloutState::ALL.iter().copied().map(Some).chain([None]) {
            let filter = RolloutFilter {
                state,
                before: None,
                limit: MANY,
            };
            ask!(self, "rollouts", rollouts(&filter));
            let some = RolloutFilter {
                before: Some(3),
                limit: 1,
                ..filter
            };
            ask!(self, "rollouts", rollouts(&some));
        }
        for number in NUMBERS {
            ask!(self, "rollout", rollout(RolloutId(number)));
            ask!(self, "rollout_robots", rollout_robots(RolloutId(number)));
        }
    }

    async fn certificates(&mut self) {
        let all = CertificateFilter {
            limit: MANY,
            ..CertificateFilter::default()
        };
        ask!(self, "certificates", certificates(&all));
        for robot in robots() {
            let of_robot = CertificateFilter {
                robot: Some(robot),
                before: Some(4),
                limit: 2,
                ..CertificateFilter::default()
            };
            ask!(self, "certificates", certificates(&of_robot));
        }
        let between = CertificateFilter {
            from_ns: Some(WallTime((NOW_S + 100) * 1_000_000_000)),
            to_ns: Some(WallTime((NOW_S + 500) * 1_000_000_000)),
            ..all
        };
        ask!(self, "certificates", certificates(&between));
        for number in NUMBERS {
            ask!(self, "certificate", certificate(DeploymentId(number)));
        }
    }

    async fn audit(&mut self) {
        let all = AuditFilter {
            limit: MANY,
            ..AuditFilter::default()
        };
        ask!(self, "audit", audit(&all));
        for action in ["proposal.approve", "proposal.approve_", "event", "%", ""] {
            let action = Some(action.to_owned());
            ask!(
                self,
                "audit",
                audit(&AuditFilter {
                    action,
                    ..all.clone()
                })
            );
        }
        for robot in robots() {
            let of_robot = AuditFilter {
                actor: Some(robot.as_str().to_owned()),
                robot: Some(robot),
                ..all.clone()
            };
            ask!(self, "audit", audit(&of_robot));
        }
        let between = AuditFilter {
            from_ns: Some(WallTime((NOW_S + 100) * 1_000_000_000)),
            to_ns: Some(WallTime((NOW_S + 500) * 1_000_000_000)),
            before: Some(7),
            limit: 3,
            ..AuditFilter::default()
        };
        ask!(self, "audit", audit(&between));
        ask!(self, "audit_last", audit_last());
        ask!(self, "audit_after", audit_after(AuditId(0), MANY));
        ask!(self, "audit_after", audit_after(AuditId(3), 2));
        for robot in robots() {
            ask!(self, "notes_after", notes_after(&robot, AuditId(0), MANY));
            ask!(self, "notes_after", notes_after(&robot, AuditId(3), 1));
        }
    }

    async fn alerts(&mut self) {
        ask!(self, "active_alerts", active_alerts());
        let all = AlertFilter {
            limit: MANY,
            ..AlertFilter::default()
        };
        ask!(self, "alerts", alerts(&all));
        let after = AlertFilter {
            after: Some((2, 3)),
            ..all.clone()
        };
        ask!(self, "alerts", alerts(&after));
        let mut selections = vec![AlertSelection::Active];
        selections.extend(ConditionName::ALL.iter().copied().map(AlertSelection::In));
        for selection in selections {
            let selection = Some(selection);
            ask!(
                self,
                "alerts",
                alerts(&AlertFilter {
                    selection,
                    ..all.clone()
                })
            );
        }
        for robot in robots() {
            let robot = Some(robot);
            ask!(
                self,
                "alerts",
                alerts(&AlertFilter {
                    robot,
                    ..all.clone()
                })
            );
        }
        for number in NUMBERS {
            ask!(self, "alert", alert(AlertId(number)));
        }
    }

    async fn webhooks(&mut self) {
        ask!(self, "webhooks", webhooks());
        ask!(self, "waiting_deliveries", waiting_deliveries());
        for second in [0, 100, 600, 100_000] {
            let now = WallTime((NOW_S + second) * 1_000_000_000);
            ask!(self, "due_deliveries", due_deliveries(now));
        }
        for number in NUMBERS {
            ask!(
                self,
                "deliveries",
                deliveries(WebhookId(number), None, MANY)
            );
            ask!(
                self,
                "deliveries",
                deliveries(WebhookId(number), Some(3), 1)
            );
        }
    }
}
