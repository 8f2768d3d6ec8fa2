//! Repeatability: disjoint blocks of a real drive agree, by the sigmas that they claim.

use std::path::{Path, PathBuf};

use fleetcal_tests::{binary, recording};
use serde_json::Value;
use tempfile::TempDir;

use crate::recordings::recorded::Recorded;

const FOUR: [&str; 4] = ["steering_offset", "lidar_x", "lidar_y", "lidar_yaw"];
/// Largest distance of blocks from their joint value, in their sigmas.
const SIGMAS: f64 = 3.0;
/// Largest mean square of these distances over the four parameters: 1 is expected. With the sigmas
/// of formal fits of this recording, four times too small, it would be 16.
const MEAN_SQUARE_MAX: f64 = 3.3;

/// Splits a recording into blocks of equal time, as recordings of their own.
fn blocks(path: &Path, count: u64, folder: &Path) -> Vec<PathBuf> {
    let recorded = Recorded::read(path);
    let length = recorded.length_ns / count + 1;
    (0..count)
        .map(|block| {
            let path = folder.join(format!("block_{block}_of_{count}.mcap"));
            recorded.write(&path, block * length..(block + 1) * length);
            path
        })
        .collect()
}

/// Returns the chi-squared of the blocks' values of a parameter about their weighted mean, for each
/// degree of freedom.
fn apart(name: &str, reports: &[Value]) -> f64 {
    let found: Vec<_> = reports
        .iter()
        .map(|report| {
            let number = |key: &str| report["parameters"][name][key].as_f64().unwrap();
            (number("value"), number("sigma"))
        })
        .collect();
    let weights: f64 = found.iter().map(|(_, sigma)| sigma.powi(-2)).sum();
    let weighed = found.iter().map(|(value, sigma)| value * sigma.powi(-2));
    let mean = weighed.sum::<f64>() / weights;
    let squares = found
        .iter()
        .map(|(value, sigma)| ((value - mean) / sigma).powi(2));
    let chi2 = squares.sum::<f64>() / (found.len() - 1) as f64;
    eprintln!("{name}: {:.2} sigma apart, {found:.4?}", chi2.sqrt());
    chi2
}

/// Checks the one real recording that has drive data, in halves, thirds and quarters; a quarter is
/// 9 m.
#[test]
fn blocks_of_a_real_drive_agree_within_what_they_claim() {
    let Some(path) = recording::named("sapienza_tricycle.mcap") else {
        return;
    };
    let folder = TempDir::new().unwrap();
    for count in 2..=4 {
        let reports: Vec<_> = blocks(&path, count, folder.path())
            .iter()
            .map(|block| {
                let block = block.to_str().unwrap();
                let vehicle = ["--model", "tricycle", "--wheelbase", "1.54757"];
                binary::run_json(["calibrate", block, "--json"].iter().chain(&vehicle))
            })
            .collect();
        let squares = FOUR.map(|name| apart(name, &reports));
        for (name, square) in FOUR.iter().zip(squares) {
            let sigmas = square.sqrt();
            assert!(
                sigmas < SIGMAS,
                "{name}: {count} blocks lie {sigmas:.1} sigma apart"
            );
        }
        let mean = squares.iter().sum::<f64>() / squares.len() as f64;
        eprintln!("{count} blocks: mean square {mean:.2}");
        assert!(
            mean < MEAN_SQUARE_MAX,
            "{count} blocks: mean square {mean:.2}"
        );
    }
}
