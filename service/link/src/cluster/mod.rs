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

/// What the part of the link works with that serves a cluster.
#[derive(Debug, Clone)]
pub struct ClusterParts {
    /// What every part works with.
    pub parts: Parts,
    /// This process's place in the cluster.
    pub cluster: Arc<Cluster>,
    /// Whether robots can connect to the session itself.
    pub listens: bool,
    /// Where the link says how it is.
    pub report: watch::Sender<LinkReport>,
}

/// The part of the link that serves a cluster.
#[derive(Debug)]
pub struct ClusterLink {
    digests: Subscriber<()>,
    services: Subscriber<()>,
    tasks: Vec<JoinHandle<()>>,
}

impl ClusterLink {
    /// Begins to listen to the other instances, to tell them, and to answer robots.
    ///
    /// # Errors
    /// When Zenoh refuses to declare something.
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

    /// Ends it; the tasks have been told to stop.
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
