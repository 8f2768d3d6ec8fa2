//! An instance of a cluster, as a test begins it.

use fleetcal_cluster::InstanceId;
use fleetcal_postgres::{Fencing, JobRuns, PostgresSetup, Sharing, open_with};
use fleetcal_store::cluster::Joining;
use fleetcal_store::{Store, StoreError};

use crate::clock;

/// Makes the name of an instance.
pub fn instance(name: &str) -> InstanceId {
    InstanceId::parse(name).unwrap()
}

/// Makes the description of an instance that joins.
pub fn joining(name: &str) -> Joining {
    Joining {
        instance: instance(name),
        url: format!("http://{name}:8080"),
        capacity: 1,
        program: "0.2.0".to_owned(),
        checkpoint_format: 2,
        config_sha256: vec![7; 32],
        signing_key: "key of the site".to_owned(),
        former_signing_keys: Vec::new(),
    }
}

/// Opens the store of an instance, which has not joined yet.
///
/// # Errors
/// Errors of [`fleetcal_postgres::open`].
pub async fn open_instance(
    setup: PostgresSetup,
    name: &str,
    fencing: Fencing,
) -> Result<Store, StoreError> {
    let sharing = Sharing::Instance(instance(name), fencing);
    open_with(setup, Box::new(()), clock() as _, JobRuns::Once, sharing).await
}
