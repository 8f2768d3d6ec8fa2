//! The calibration's topics in the graph of ROS 2: `ros2 topic list` of `rmw_zenoh` shows what
//! liveliness tokens announce, and nothing else.

use std::collections::{BTreeMap, BTreeSet};

use fleetcal_domain::limits;
use tokio_util::sync::CancellationToken;
use zenoh::liveliness::LivelinessToken;
use zenoh::{Result, Session};

use super::calibration::Home;
use super::{Ros2, warn_if_refused};

/// Tokens that are present, of a node and its publisher in each robot's namespace.
#[derive(Debug, Default)]
struct Graph {
    declared: BTreeMap<Home, [LivelinessToken; 2]>,
    /// Number of the next node and publisher within their session.
    next: u64,
}

/// Announces the topic in the namespace of every robot that can receive it, until `stop`.
pub async fn announce(session: Session, ros2: Ros2, stop: CancellationToken) {
    let mut graph = Graph::default();
    loop {
        let all_stand = graph.follow(&session, ros2.all_homes()).await;
        tokio::select! {
            () = stop.cancelled() => break,
            () = ros2.shared.homes_changed.notified() => {}
            () = tokio::time::sleep(limits::POST_RETRY), if !all_stand => {}
        }
    }
    graph.follow(&session, BTreeSet::new()).await;
}

impl Graph {
    /// Declares wanted tokens and undeclares others; returns whether all are in place now.
    async fn follow(&mut self, session: &Session, wanted: BTreeSet<Home>) -> bool {
        let gone: Vec<Home> = self
            .declared
            .keys()
            .filter(|&home| !wanted.contains(home))
            .cloned()
            .collect();
        for home in gone {
            for token in self.declared.remove(&home).into_iter().flatten() {
                warn_if_refused(token.undeclare().await);
            }
        }
        let mut all_stand = true;
        for home in wanted {
            if self.declared.contains_key(&home) {
                continue;
            }
            let Some(tokens) = home.tokens(&session.zid().to_string(), self.next) else {
                continue;
            };
            self.next += 2;
            match declare(session, tokens).await {
                Ok(tokens) => {
                    self.declared.insert(home, tokens);
                }
                Err(error) => {
                    let key = home.key();
                    tracing::warn!(error, key, "a topic is not announced to ROS 2");
                    all_stand = false;
                }
            }
        }
        all_stand
    }
}

async fn declare(session: &Session, tokens: [String; 2]) -> Result<[LivelinessToken; 2]> {
    let [node, publisher] = tokens;
    let liveliness = session.liveliness();
    Ok([
        liveliness.declare_token(node).await?,
        liveliness.declare_token(publisher).await?,
    ])
}
