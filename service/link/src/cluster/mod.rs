//! Link of an instance where several carry the fleet: it hears the robots that this
//! instance has or is to have, tells the others of them, and says who is there.

mod answering;
mod digests;
mod discovery;
mod presence;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use fleetcal_cluster::{Cluster, LinkReport};
use tokio::sync::watch;
use tokio::task::JoinHandle;
use zenoh::Result;
use zenoh::pubsub::Subscriber;
use zenoh::query::Queryable;

use crate::{Parts, warn_if_refused};

/// Context of the cluster's part of the link.
#[derive(Debug, Clone)]
pub struct ClusterParts {
    /// Context of every part.
    pub parts: Parts,
    /// This process's place in the cluster.
    pub cluster: Arc<Cluster>,
    /// True if robots can connect to the session itself.
    pub listens: bool,
    /// Channel of the link's state.
    pub report: watch::Sender<LinkReport>,
}

/// Cluster's part of the link.
#[derive(Debug)]
pub struct ClusterLink {
    digests: Subscriber<()>,
    services: Subscriber<()>,
    tasks: Vec<JoinHandle<()>>,
}

impl ClusterLink {
    /// Begins to receive and publish digests, and to answer robots.
    ///
    /// # Errors
    /// Zenoh refuses a declaration.
    pub async fn open(of: ClusterParts) -> Result<Self> {
        let (digests, reading) = digests::hear(&of).await?;
        let services = presence::watch_services(&of).await?;
        let tasks = vec![
            reading,
            tokio::spawn(digests::tell(of.clone())),
            tokio::spawn(digests::send_heartbeats(of.clone())),
            tokio::spawn(answering::answer(of.clone())),
            tokio::spawn(presence::watch_link(of.clone())),
            tokio::spawn(discovery::listen(of)),
        ];
        Ok(Self {
            digests,
            services,
            tasks,
        })
    }

    /// Closes this part; the tasks have been stopped before.
    pub async fn close(self) {
        for undeclared in [
            self.digests.undeclare().await,
            self.services.undeclare().await,
        ] {
            warn_if_refused(undeclared);
        }
        for task in self.tasks {
            if let Err(error) = task.await {
                tracing::error!(%error, "a task of the link to other instances failed");
            }
        }
    }
}

async fn undeclare_all(queryables: Vec<Queryable<()>>) {
    for queryable in queryables {
        warn_if_refused(queryable.undeclare().await);
    }
}
