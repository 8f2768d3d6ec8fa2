//! The calibration's topics in the graph of ROS 2: `ros2 topic list` of `rmw_zenoh` shows what
//! liveliness tokens announce, and nothing else.

use std::collections::{BTreeMap, BTreeSet};

use tokio_util::sync::CancellationToken;
use zenoh::liveliness::LivelinessToken;
use zenoh::{Result, Session};

use super::calibration::Home;
use super::{Ros2, warn_if_refused};

/// The tokens that stand, of a node and its publisher in each robot's namespace.
#[derive(Debug, Default)]
struct Graph {
    declared: BTreeMap<Home, [LivelinessToken; 2]>,
    /// Nodes and publishers are numbered within their session.
    next: u64,
}

/// Announces the topic wherever a robot that would hear it has its own, until `stop`.
pub async fn announce(session: Session, ros2: Ros2, stop: CancellationToken) {
    let mut graph = Graph::default();
    loop {
        if let Err(error) = graph.follow(&session, ros2.all_homes()).await {
            tracing::warn!(error, "a topic is not announced to ROS 2");
        }
        tokio::select! {
            () = stop.cancelled() => break,
            () = ros2.shared.homes_changed.notified() => {}
        }
    }
    warn_if_refused(graph.follow(&session, BTreeSet::new()).await);
}

impl Graph {
    async fn follow(&mut self, session: &Session, wanted: BTreeSet<Home>) -> Result<()> {
        let gone: Vec<Home> = self
            .declared
            .keys()
            .filter(|&home| !wanted.contains(home))
            .cloned()
            .collect();
        for home in gone {
            for token in self.declared.remove(&home).into_iter().flatten() {
                token.undeclare().await?;
            }
        }
        for home in wanted {
            if self.declared.contains_key(&home) {
                continue;
            }
            let Some([node, publisher]) = home.tokens(&session.zid().to_string(), self.next) else {
                continue;
            };
            self.next += 2;
            let liveliness = session.liveliness();
            let tokens = [
                liveliness.declare_token(node).await?,
                liveliness.declare_token(publisher).await?,
            ];
            self.declared.insert(home, tokens);
        }
        Ok(())
    }
}
