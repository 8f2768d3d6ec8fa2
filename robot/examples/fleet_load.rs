//! Prints what a simulated fleet costs: `cargo run --release -p fleetcal-robot --example fleet_load
//! -- 50 20` runs 50 robots for 20 s against a router in the same process.

use std::error::Error;
use std::io::Write;
use std::num::NonZeroU32;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use fleetcal_ports::free_address;
use fleetcal_proto::{Keys, StreamKind};
use fleetcal_robot::fleet::{DriveMessages, FleetOptions, run_fleet, simulated_robots};
use tokio_util::sync::CancellationToken;

/// Clock ticks a second in `/proc/self/stat`: the same on every Linux.
const TICKS_PER_S: f64 = 100.0;

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error + Send + Sync>> {
    let mut arguments = std::env::args().skip(1);
    let robots = arguments.next().map_or(Ok(50), |text| text.parse())?;
    let duration_s = arguments.next().map_or(Ok(20), |text| text.parse())?;
    let endpoint = format!("tcp/{}", free_address());
    let router = router(&endpoint).await?;
    let keys = Keys::default();
    let drives = count(&router, &keys.stream_of_all(StreamKind::WheelOdometry)).await?;
    let scans = count(&router, &keys.stream_of_all(StreamKind::Scan)).await?;

    let options = FleetOptions {
        robots: simulated_robots(robots, 1)?,
        connect: vec![endpoint].into(),
        keys,
        trusted: None,
        start_stamp_ns: 1_760_000_000_000_000_000,
        rate: NonZeroU32::MIN,
        drive_messages: DriveMessages::default(),
    };
    let stop = CancellationToken::new();
    let before_s = cpu_s()?;
    let fleet = tokio::spawn(run_fleet(options, stop.clone()));
    tokio::time::sleep(Duration::from_secs(duration_s)).await;
    stop.cancel();
    let summaries = fleet.await??;
    let cores = (cpu_s()? - before_s) / duration_s as f64;
    tokio::time::sleep(Duration::from_millis(500)).await;

    let sent: u64 = summaries.iter().map(|robot| robot.drive_samples).sum();
    let sent_scans: u64 = summaries.iter().map(|robot| robot.scans).sum();
    let late: u64 = summaries.iter().map(|robot| robot.late).sum();
    let (received, received_scans) = (drives.load(Ordering::SeqCst), scans.load(Ordering::SeqCst));
    writeln!(
        std::io::stdout(),
        "{robots} robots, {duration_s} s: {cores:.2} cores with the router; \
         drive {received} of {sent}, scans {received_scans} of {sent_scans}, {late} late"
    )?;
    Ok(())
}

async fn router(endpoint: &str) -> zenoh::Result<zenoh::Session> {
    let mut config = zenoh::Config::default();
    config.insert_json5("mode", "\"router\"")?;
    config.insert_json5("listen/endpoints", &format!("[\"{endpoint}\"]"))?;
    config.insert_json5("scouting/multicast/enabled", "false")?;
    zenoh::open(config).await
}

async fn count(router: &zenoh::Session, key: &str) -> zenoh::Result<Arc<AtomicU64>> {
    let counter = Arc::new(AtomicU64::new(0));
    let counted = Arc::clone(&counter);
    let callback = move |_| {
        counted.fetch_add(1, Ordering::SeqCst);
    };
    router
        .declare_subscriber(key.to_owned())
        .callback(callback)
        .background()
        .await?;
    Ok(counter)
}

/// Returns the processor time this process has used, s.
fn cpu_s() -> Result<f64, Box<dyn Error + Send + Sync>> {
    let stat = std::fs::read_to_string("/proc/self/stat")?;
    // Behind the name in brackets: state, ten other fields, then user and system time.
    let (_, fields) = stat.rsplit_once(')').ok_or("no name in /proc/self/stat")?;
    let times = fields.split_whitespace().skip(11).take(2);
    let ticks: Vec<f64> = times.map(str::parse).collect::<Result<_, _>>()?;
    Ok(ticks.iter().sum::<f64>() / TICKS_PER_S)
}
