//! Retirement of a robot, stored and read again.

use super::*;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_retirement_outlives_a_restart_and_messages_are_refused() {
    let bench = Bench::open(Policy::default()).await;
    let retire = Command::Retire {
        reason: "sold".to_owned(),
    };
    bench.take(retire.clone(), person("bo")).await.unwrap();

    let bench = bench.restart().await;
    let ledger = bench.lifecycle.ledger(&robot());
    let retired = ledger.shadow.retired.clone().unwrap();
    assert_eq!((&*retired.by, &*retired.reason), ("bo", "sold"));
    let refused = || bench.fleet.robot(&robot()).unwrap().counters.refused;
    let send = || {
        let form = fleetcal_proto::encoding::Encoding::Json;
        let stream = fleetcal_model::Stream::WheelOdometry;
        bench
            .fleet
            .receive(&robot(), stream, form, 2, || b"{}".to_vec());
    };
    let before = refused();
    send();
    assert_eq!(refused(), before + 1);
    let again = bench.take(retire, person("bo")).await;
    assert!(matches!(again, Err(Refused::Retired { .. })), "{again:?}");

    let bring_back = Command::BringBack {
        reason: "bought back".to_owned(),
    };
    bench.take(bring_back, person("bo")).await.unwrap();
    let bench = bench.restart().await;
    assert_eq!(bench.lifecycle.ledger(&robot()).shadow.retired, None);
}
