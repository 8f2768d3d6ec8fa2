//! Do disjoint blocks of a real drive agree, by the sigmas that they claim?

use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use fleetcal_tests::{binary, recording};
use tempfile::TempDir;

/// Blocks of equal time; shorter ones drive less than a figure is known from.
const BLOCKS: u64 = 2;
const FOUR: [&str; 4] = ["steering_offset", "lidar_x", "lidar_y", "lidar_yaw"];

/// The blocks of a recording, as recordings of their own.
fn blocks(path: &Path, folder: &Path) -> Vec<PathBuf> {
    let bytes = fs::read(path).unwrap();
    let messages: Vec<_> = mcap::MessageStream::new(&bytes)
        .unwrap()
        .map(Result::unwrap)
        .collect();
    let first = messages.iter().map(|m| m.log_time).min().unwrap();
    let last = messages.iter().map(|m| m.log_time).max().unwrap();
    let length = (last - first) / BLOCKS + 1;
    (0..BLOCKS)
        .map(|block| {
            let path = folder.join(format!("block_{block}.mcap"));
            let mut writer =
                mcap::Writer::new(BufWriter::new(File::create(&path).unwrap())).unwrap();
            for message in &messages {
                if (message.log_time - first) / length == block {
                    writer.write(message).unwrap();
                }
            }
            writer.finish().unwrap();
            path
        })
        .collect()
}

#[test]
fn blocks_of_a_real_drive_agree_within_what_they_claim() {
    let Some(path) = recording::named("sapienza_tricycle.mcap") else {
        return;
    };
    let folder = TempDir::new().unwrap();
    let reports: Vec<_> = blocks(&path, folder.path())
        .iter()
        .map(|block| {
            let block = block.to_str().unwrap();
            let vehicle = ["--model", "tricycle", "--wheelbase", "1.54757"];
            binary::run_json(["calibrate", block, "--json"].iter().chain(&vehicle))
        })
        .collect();
    let mut squares = 0.0;
    for name in FOUR {
        let found: Vec<_> = reports
            .iter()
            .map(|report| {
                let number = |key: &str| report["parameters"][name][key].as_f64().unwrap();
                (number("value"), number("sigma"))
            })
            .collect();
        eprintln!("{name}: {found:.4?}");
        let weights: f64 = found.iter().map(|(_, sigma)| sigma.powi(-2)).sum();
        let weighed = found.iter().map(|(value, sigma)| value * sigma.powi(-2));
        let mean = weighed.sum::<f64>() / weights;
        let apart = found
            .iter()
            .map(|(value, sigma)| ((value - mean) / sigma).powi(2));
        let chi2 = apart.sum::<f64>() / (BLOCKS - 1) as f64;
        assert!(
            chi2 < 9.0,
            "{name}: blocks lie {:.1} sigma apart",
            chi2.sqrt()
        );
        squares += chi2 / FOUR.len() as f64;
    }
    eprintln!("mean square of the blocks' distances: {squares:.2} sigma^2");
    // With sigmas as formal fits of this recording have them, four times too small, it would be 16.
    assert!(squares < 3.3, "mean square {squares:.2} sigma^2");
}
