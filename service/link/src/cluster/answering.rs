//! Answers robots for as long as the database is reached: an instance that does not reach it knows
//! nothing of what others have decided, and leaves robots to them.

use fleetcal_domain::limits::{CLUSTER_LOOK_EVERY, CLUSTER_UNANSWERED_AFTER};
use tokio::time::MissedTickBehavior;
use zenoh::Result;
use zenoh::liveliness::LivelinessToken;
use zenoh::query::Queryable;

use super::{ClusterParts, undeclare_all};
use crate::{calibration, warn_if_refused};

/// Declarations that answer robots.
#[derive(Debug, Default)]
struct Declared {
    queryables: Vec<Queryable<()>>,
    /// Token of the service. A robot that sees it finds all other declarations in place. It remains
    /// while the process lives.
    token: Option<LivelinessToken>,
}

/// Declares the queryables for robots, and undeclares them without the database, until the link
/// ends.
pub async fn answer(of: ClusterParts) {
    let mut ticks = tokio::time::interval(CLUSTER_LOOK_EVERY);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut declared = Declared::default();
    loop {
        tokio::select! {
            () = of.parts.stop.cancelled() => break,
            _ = ticks.tick() => {}
        }
        if let Err(error) = declared.follow(&of).await {
            tracing::warn!(error, "Zenoh refused to declare what answers robots");
        }
    }
    if let Some(token) = declared.token {
        warn_if_refused(token.undeclare().await);
    }
    undeclare_all(declared.queryables).await;
}

impl Declared {
    async fn follow(&mut self, of: &ClusterParts) -> Result<()> {
        let answered = of.cluster.answered_at();
        let silent_for = answered.map(|at| of.parts.clock.uptime().saturating_sub(at));
        let is_reached = silent_for.is_some_and(|silent| silent < CLUSTER_UNANSWERED_AFTER);
        match (is_reached, self.queryables.is_empty()) {
            (true, true) => self.queryables = declare(of).await?,
            (false, false) => {
                tracing::warn!("the database does not answer: robots are left to others");
                undeclare_all(std::mem::take(&mut self.queryables)).await;
            }
            _ => {}
        }
        if is_reached && self.token.is_none() {
            let key = of.parts.keys.service(of.cluster.instance());
            let declared = of.parts.session.liveliness().declare_token(key).await?;
            self.token = Some(declared);
            of.report
                .send_if_modified(|report| report.present.insert(of.cluster.instance().clone()));
        }
        Ok(())
    }
}

async fn declare(of: &ClusterParts) -> Result<Vec<Queryable<()>>> {
    let asked = calibration::Asked {
        session: &of.parts.session,
        keys: &of.parts.keys,
        lifecycle: &of.parts.lifecycle,
        questions: &of.parts.questions,
        // A robot asks all instances, and takes the newest of what they say.
        complete: false,
    };
    let approved = calibration::answer_approved(&asked).await?;
    match calibration::answer_confirmed(&asked).await {
        Ok(confirmed) => Ok(vec![approved, confirmed]),
        Err(error) => {
            undeclare_all(vec![approved]).await;
            Err(error)
        }
    }
}
