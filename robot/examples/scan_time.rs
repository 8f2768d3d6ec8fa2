//! Prints the time a simulated robot takes: `cargo run --release -p fleetcal-robot --example
//! scan_time --no-default-features`.

use std::io::Write;
use std::time::Instant;

use fleetcal_robot::simulator::{
    LidarOutput, PoseSettings, Route, SettingRefused, Simulation, SimulationConfig,
};

/// Simulated time of each measurement, s.
const DURATION_S: f64 = 60.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut out = std::io::stdout().lock();
    for people in [0, 3, 60] {
        let mut config = SimulationConfig::figure_eight(1);
        config.people.count = people;
        let mut aisles = config.clone();
        aisles.route = Route::aisle_loop();
        let mut no_rays = config.clone();
        no_rays.lidar = LidarOutput::Poses(PoseSettings::default());
        let drive_s = seconds(no_rays)?;
        for (name, config) in [("figure-eight", config), ("aisle loop", aisles)] {
            let total_s = seconds(config)?;
            let scan_ms = (total_s - drive_s) / (DURATION_S * 10.0) * 1e3;
            let load = total_s / DURATION_S * 1e2;
            writeln!(
                out,
                "{name}, {people} people: {scan_ms:.3} ms a scan of 1024 beams, \
                 {load:.2} % of a core for a robot"
            )?;
        }
    }
    Ok(())
}

#[expect(clippy::disallowed_methods, reason = "this example measures real time")]
fn seconds(config: SimulationConfig) -> Result<f64, SettingRefused> {
    let mut simulation = Simulation::new(config)?;
    let start = Instant::now();
    let messages = simulation.run(DURATION_S);
    let elapsed_s = start.elapsed().as_secs_f64();
    drop(messages);
    Ok(elapsed_s)
}
