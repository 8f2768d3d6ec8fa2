//! Down-sampling, roll-ups and retention.

use std::f64::consts::PI;
use std::sync::Arc;
use std::time::Duration;

use fleetcal_contract::{NOW_S, NS, TestDatabase, clock, estimate, query, record};
use fleetcal_model::{Parameter, WallTime};
use fleetcal_store::{Cell, History, HistoryQuery, Store};

const START_S: i64 = NOW_S - NOW_S % 3_600;

fn offsets(history: &History) -> Vec<Cell> {
    history
        .stretches
        .iter()
        .map(|stretch| stretch.cells[0].unwrap())
        .collect()
}

fn close_to(a: f64, b: f64) -> bool {
    (a - b).abs() < 1e-12
}

/// Waits until the writer has deleted `rows` rows.
async fn pruned(store: &Store, rows: u64) {
    let done = async {
        while store.counters().pruned_rows < rows {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    tokio::time::timeout(Duration::from_secs(30), done)
        .await
        .unwrap();
}

#[tokio::test]
async fn seconds_come_back_as_they_were() {
    let database = TestDatabase::new().await;
    let store = database.open(clock()).await;
    for second in [0, 1, 2, 5] {
        record(&store, "a", START_S + second, second as f64);
        record(&store, "b", START_S + second, -1.0);
    }
    store.flush().await.unwrap();
    let history = store
        .history(&query("a", START_S, START_S + 6, 600))
        .await
        .unwrap();
    assert_eq!(history.bucket_s, 1);
    let times: Vec<_> = history
        .stretches
        .iter()
        .map(|stretch| stretch.t_s - START_S)
        .collect();
    assert_eq!(times, [0, 1, 2, 5]);
    assert_eq!(
        offsets(&history)[3],
        Cell {
            mean: 5.0,
            min: 5.0,
            max: 5.0,
            sigma: 0.01
        }
    );
    assert_eq!(history.stretches[0].nis, Some(3.0));
    // The end is not part of the span, and an unknown robot has no history.
    let history = store
        .history(&query("a", START_S, START_S + 5, 600))
        .await
        .unwrap();
    assert_eq!(history.stretches.len(), 3);
    assert!(
        store
            .history(&query("c", START_S, START_S + 5, 600))
            .await
            .unwrap()
            .stretches
            .is_empty()
    );
}

#[tokio::test]
async fn fixed_parameters_have_no_history() {
    let database = TestDatabase::new().await;
    let store = database.open(clock()).await;
    record(&store, "a", START_S, 0.1);
    store.flush().await.unwrap();
    let parameters = vec![Parameter::Wheelbase, Parameter::LidarX];
    let query = HistoryQuery {
        parameters,
        ..query("a", START_S, START_S + 1, 2)
    };
    let history = store.history(&query).await.unwrap();
    assert_eq!(history.stretches[0].cells[0], None);
    assert!(close_to(history.stretches[0].cells[1].unwrap().mean, 0.5));
}

#[tokio::test]
async fn down_sampling_keeps_extremes_and_the_limit() {
    let database = TestDatabase::new().await;
    let store = database.open(clock()).await;
    let span_s = 3 * 3_600;
    for second in 0..span_s {
        let spike = match second {
            4_321 => 9.0,
            7_654 => -9.0,
            _ => 0.0,
        };
        record(&store, "a", START_S + second, spike);
        if second % 4_000 == 0 {
            store.flush().await.unwrap();
        }
    }
    store.flush().await.unwrap();
    for points_max in [2, 7, 60, 599, 5_000] {
        let query = query("a", START_S + 13, START_S + span_s, points_max);
        let history = store.history(&query).await.unwrap();
        assert!(
            history.stretches.len() <= points_max as usize,
            "{points_max}"
        );
        let cells = offsets(&history);
        let max = cells.iter().map(|cell| cell.max).fold(f64::MIN, f64::max);
        let min = cells.iter().map(|cell| cell.min).fold(f64::MAX, f64::min);
        assert_eq!((min, max), (-9.0, 9.0), "{points_max}");
        let seconds: u32 = history.stretches.iter().map(|stretch| stretch.count).sum();
        assert_eq!(i64::from(seconds), span_s - 13, "{points_max}");
    }
    assert_eq!(store.counters().refused, 0);
}

#[tokio::test]
async fn minutes_and_hours_tell_what_the_seconds_told() {
    let database = TestDatabase::new().await;
    let clock = clock();
    let store = database.open(Arc::clone(&clock)).await;
    for second in 0..150 {
        record(&store, "a", START_S + second, (second % 60) as f64);
    }
    store.flush().await.unwrap();
    clock.advance(Duration::from_hours(4 * 24));
    pruned(&store, 150).await;
    let history = store
        .history(&query("a", START_S, START_S + 150, 600))
        .await
        .unwrap();
    assert_eq!(history.bucket_s, 60);
    let counts: Vec<_> = history
        .stretches
        .iter()
        .map(|stretch| stretch.count)
        .collect();
    assert_eq!(counts, [60, 60, 30]);
    let cells = offsets(&history);
    assert!(
        close_to(cells[0].mean, 29.5) && close_to(cells[2].mean, 14.5),
        "{cells:?}"
    );
    assert_eq!((cells[1].min, cells[1].max), (0.0, 59.0));
    assert!(close_to(cells[0].sigma, 0.01));

    clock.advance(Duration::from_hours(100 * 24));
    pruned(&store, 153).await;
    let history = store
        .history(&query("a", START_S, START_S + 150, 600))
        .await
        .unwrap();
    assert_eq!((history.bucket_s, history.stretches.len()), (3_600, 1));
    assert_eq!(history.stretches[0].count, 150);
    let all: i64 = (0..150).map(|second| second % 60).sum();
    assert!(close_to(offsets(&history)[0].mean, all as f64 / 150.0));

    clock.advance(Duration::from_hours(6 * 365 * 24));
    pruned(&store, 154).await;
    assert!(
        store
            .history(&query("a", START_S, START_S + 150, 600))
            .await
            .unwrap()
            .stretches
            .is_empty()
    );
}

#[tokio::test]
async fn retention_goes_by_receipt_time() {
    let database = TestDatabase::new().await;
    let store = database.open(clock()).await;
    // A robot whose clock is in 1980 sends now; one whose clock is in 2060 sent a week ago.
    let (past_s, future_s) = (315_532_800, 2_840_140_800);
    store.record_history(&estimate("past", past_s, 1.0, 0.0), WallTime(NOW_S * NS));
    store.record_history(
        &estimate("future", future_s, 1.0, 0.0),
        WallTime((NOW_S - 7 * 86_400) * NS),
    );
    store.flush().await.unwrap();
    pruned(&store, 1).await;
    let seconds = |name: &'static str, t_s| {
        let store = store.clone();
        async move { store.history(&query(name, t_s, t_s + 1, 2)).await.unwrap() }
    };
    assert_eq!(seconds("past", past_s).await.bucket_s, 1);
    // What is left of the other one is its minute.
    assert_eq!(seconds("future", future_s).await.bucket_s, 60);
}

#[tokio::test]
async fn coarser_rows_go_before_the_finer_ones_without_overlap() {
    let database = TestDatabase::new().await;
    let clock = clock();
    let store = database.open(Arc::clone(&clock)).await;
    for second in 0..200 {
        record(&store, "a", START_S + second, 1.0);
    }
    store.flush().await.unwrap();
    clock.advance(Duration::from_hours(4 * 24));
    pruned(&store, 200).await;
    // The robot goes on in the same minute, received today.
    for second in 200..400 {
        let estimate = estimate("a", START_S + second, 1.0, 0.0);
        store.record_history(&estimate, WallTime((NOW_S + 4 * 86_400) * NS));
    }
    store.flush().await.unwrap();
    let history = store
        .history(&query("a", START_S, START_S + 400, 600))
        .await
        .unwrap();
    assert_eq!(history.bucket_s, 60);
    let counts: Vec<_> = history
        .stretches
        .iter()
        .map(|stretch| stretch.count)
        .collect();
    assert_eq!(counts, [60, 60, 60, 40, 60, 60, 40]);
}

#[tokio::test]
async fn a_recording_replayed_again_replaces_its_first_run() {
    let database = TestDatabase::new().await;
    let clock = clock();
    let store = database.open(Arc::clone(&clock)).await;
    for value in [1.0, 3.0] {
        for second in 0..90 {
            record(&store, "a", START_S + second, value);
        }
        store.flush().await.unwrap();
    }
    clock.advance(Duration::from_hours(4 * 24));
    pruned(&store, 90).await;
    let history = store
        .history(&query("a", START_S, START_S + 90, 600))
        .await
        .unwrap();
    let told: Vec<_> = history
        .stretches
        .iter()
        .map(|s| (s.count, s.cells[0].unwrap()))
        .collect();
    let cell = Cell {
        mean: 3.0,
        min: 3.0,
        max: 3.0,
        sigma: 0.01,
    };
    assert_eq!(
        told.iter().map(|(count, _)| *count).collect::<Vec<_>>(),
        [60, 30]
    );
    for (_, found) in told {
        assert_eq!(
            (found.mean, found.min, found.max),
            (cell.mean, cell.min, cell.max)
        );
    }
    clock.advance(Duration::from_hours(100 * 24));
    pruned(&store, 92).await;
    let history = store
        .history(&query("a", START_S, START_S + 90, 600))
        .await
        .unwrap();
    assert_eq!(history.stretches[0].count, 90);
    assert!(close_to(offsets(&history)[0].min, 3.0));
}

#[tokio::test]
async fn a_lidar_that_looks_backwards_is_one_line() {
    let database = TestDatabase::new().await;
    let clock = clock();
    let store = database.open(Arc::clone(&clock)).await;
    for second in 0..120 {
        let yaw_rad = if second % 2 == 0 {
            PI - 0.01
        } else {
            -PI + 0.01
        };
        let estimate = estimate("a", START_S + second, 0.0, yaw_rad);
        store.record_history(&estimate, WallTime(NOW_S * NS));
    }
    store.flush().await.unwrap();
    let yaws = |history: &History| -> Vec<Cell> {
        history
            .stretches
            .iter()
            .map(|stretch| stretch.cells[1].unwrap())
            .collect()
    };
    let span = |points_max| query("a", START_S, START_S + 120, points_max);
    for points_max in [600, 3] {
        let history = store.history(&span(points_max)).await.unwrap();
        for cell in yaws(&history) {
            assert!(
                (cell.mean - PI).abs() < 0.02 && cell.max - cell.min < 0.03,
                "{cell:?}"
            );
        }
    }
    clock.advance(Duration::from_hours(4 * 24));
    pruned(&store, 120).await;
    for cell in yaws(&store.history(&span(600)).await.unwrap()) {
        assert!(
            (cell.mean - PI).abs() < 1e-3 && cell.max - cell.min < 0.03,
            "{cell:?}"
        );
    }
}
