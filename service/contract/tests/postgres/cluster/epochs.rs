//! Epochs of tenures: of two tenures of a robot the later one has the higher epoch, whatever
//! happens to servers.

use fleetcal_model::RobotId;

use super::instance::{Instance, fill};
use fleetcal_contract::own_server::{OwnServer, url_of};

async fn epoch_of_next(instance: &Instance, robots: &[RobotId], claim: i64) -> i64 {
    instance
        .registry
        .free(&instance.seat, robots)
        .await
        .unwrap();
    let tenures = instance.claim(robots, claim).await;
    assert_eq!(tenures.len(), 1, "{tenures:?}");
    tenures[0].epoch.0
}

/// Fails over to a standby that lacks the latest tenures, while the replaced server assigns more.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_epoch_only_ascends_also_after_a_failover_that_forgot_the_latest() {
    let primary = OwnServer::start_new("trust");
    let robots = fill(&primary.url("postgres"), 1).await;
    let standby = OwnServer::standby_of(&primary);
    standby.wait_until_equal(&primary);
    let hosts = [primary.host(), standby.host()];
    let url = url_of(&[&hosts[0], &hosts[1]], "fleetcal", "postgres");
    let a = Instance::join(&url, "a").await;
    let mut last = 0;
    for claim in 0..20 {
        let epoch = epoch_of_next(&a, &robots, claim).await;
        assert!(epoch > last);
        last = epoch;
    }
    assert!(last < 2 << 40, "{last}: the first timeline");
    standby.wait_until_equal(&primary);
    standby.stop();
    for claim in 20..40 {
        last = epoch_of_next(&a, &robots, claim).await;
    }
    let forgotten = a.look().await.version;

    primary.stop();
    standby.start();
    standby.promote();
    let mut renewed = false;
    for _ in 0..100 {
        let renewal = fleetcal_store::cluster::Renewal {
            linked: true,
            ..fleetcal_store::cluster::Renewal::default()
        };
        renewed = matches!(a.registry.renew(&a.seat, renewal).await, Ok(Some(_)));
        if renewed {
            break;
        }
        tokio::time::sleep(std::time::Duration::from_millis(100)).await;
    }
    assert!(renewed, "its seat was on the standby");
    let epoch = epoch_of_next(&a, &robots, 40).await;
    println!("epoch {last:#x} before, {epoch:#x} after");
    assert!(epoch > last && epoch >= 2 << 40);
    let look = a.registry.look(Some(forgotten)).await.unwrap();
    assert!(look.is_whole && look.version > forgotten);
}
