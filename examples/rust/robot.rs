//! A plain Zenoh robot: drives eights in a hall and puts what it measures where fleetcal listens.
//!
//! `fleetcal-example-robot [tcp/SERVICE:7447 [ROBOT [SECONDS [SPEEDUP [SAMPLES]]]]]`

use std::f64::consts::{PI, TAU};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use rand::{SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, Normal};
use serde_json::{Value, json};
use zenoh::pubsub::Publisher;
use zenoh::{Config, Wait, bytes::Encoding};

type Failure = Box<dyn std::error::Error + Send + Sync>;

const WHEELBASE_M: f64 = 1.2;
const SPEED_MPS: f64 = 1.0;
/// Largest steering angle to both sides, rad.
const TURN_RAD: f64 = 0.5;
/// Rate of the steering angle, rad/s.
const TURN_RATE_RADPS: f64 = 0.5;
/// True steering offset, which fleetcal is to find, rad.
const STEERING_OFFSET_RAD: f64 = 0.03;
/// True pose of the LiDAR, which fleetcal is to find (x, y, yaw), m and rad.
const LIDAR: (f64, f64, f64) = (0.4, 0.1, 0.05);
/// The hall's walls along x and y.
const HALL_M: ([f64; 2], [f64; 2]) = ([-9.0, 7.0], [-6.0, 8.0]);
const BEAMS: usize = 360;

/// Publisher of drive samples, which collects those of a message.
struct Drives<'s> {
    publisher: Publisher<'s>,
    /// Drive samples that wait for their message.
    samples: Vec<Value>,
    /// Drive samples of a message, from 1 to 10.
    samples_max: usize,
}

impl Drives<'_> {
    /// Publishes the drive samples of up to 100 ms in one message.
    fn put(&mut self, sample: Value) -> Result<(), Failure> {
        self.samples.push(sample);
        if self.samples.len() < self.samples_max {
            return Ok(());
        }
        let samples = std::mem::take(&mut self.samples);
        put(&self.publisher, &json!({ "samples": samples }))
    }
}

/// Publishes a message in JSON; CDR with the encoding `application/cdr` works as well.
fn put(publisher: &Publisher, message: &Value) -> Result<(), Failure> {
    publisher.put(message.to_string()).wait()
}

/// Returns the LiDAR's ranges to the walls, metres, with the rear axle at (x, y, yaw).
fn ranges(random: &mut StdRng, (x, y, yaw): (f64, f64, f64)) -> Result<Vec<f64>, Failure> {
    let noise = Normal::new(0.0, 0.01)?;
    let x = x + LIDAR.0 * yaw.cos() - LIDAR.1 * yaw.sin();
    let y = y + LIDAR.0 * yaw.sin() + LIDAR.1 * yaw.cos();
    let beam = |beam: usize| {
        let (s, c) = (yaw + LIDAR.2 - PI + beam as f64 * TAU / BEAMS as f64).sin_cos();
        let to_wall = |from, [low, high]: [f64; 2], along| {
            (if along > 0.0 { high } else { low } - from) / along
        };
        to_wall(x, HALL_M.0, c).min(to_wall(y, HALL_M.1, s)) + noise.sample(random)
    };
    Ok((0..BEAMS).map(beam).collect())
}

/// Drives 100 samples and 10 scans a second, in the robot's own time.
#[expect(
    clippy::disallowed_methods,
    reason = "the robot's own clock is what stamps its messages"
)]
fn drive(drives: &mut Drives, scans: &Publisher, ticks: u32, speedup: f64) -> Result<(), Failure> {
    let mut random = StdRng::seed_from_u64(1);
    let (mut x, mut y, mut yaw, mut steering) = (0.0, 0.0, 0.0, 0.0);
    let (began, pace) = (
        SystemTime::now().duration_since(UNIX_EPOCH)?,
        Instant::now(),
    );
    let circle_s = TAU * WHEELBASE_M / TURN_RAD.tan() / SPEED_MPS;
    let (steering_noise, speed_noise) = (Normal::new(0.0, 0.002)?, Normal::new(0.0, 0.005)?);
    for tick in 0..ticks {
        let time_s = f64::from(tick) / 100.0;
        let is_left = time_s % (2.0 * circle_s) < circle_s;
        let wanted = if is_left { TURN_RAD } else { -TURN_RAD };
        let most = TURN_RATE_RADPS * 0.01;
        steering += f64::clamp(wanted - steering, -most, most);
        let turn = SPEED_MPS * f64::tan(steering) / WHEELBASE_M * 0.01;
        x += SPEED_MPS * 0.01 * f64::cos(yaw + turn / 2.0);
        y += SPEED_MPS * 0.01 * f64::sin(yaw + turn / 2.0);
        yaw += turn;
        let stamp = began + Duration::from_millis(10) * tick;
        let stamp = json!({ "sec": stamp.as_secs(), "nanosec": stamp.subsec_nanos() });
        drives.put(json!({
            "stamp": stamp,
            "steering_angle": steering + STEERING_OFFSET_RAD + steering_noise.sample(&mut random),
            "speed": SPEED_MPS + speed_noise.sample(&mut random),
        }))?;
        if tick % 10 == 0 {
            let step = TAU / BEAMS as f64;
            let scan = json!({
                "header": { "stamp": stamp },
                "angle_min": -PI, "angle_max": PI - step, "angle_increment": step,
                "time_increment": 0.0, "range_min": 0.05, "range_max": 30.0,
                "ranges": ranges(&mut random, (x, y, yaw))?,
            });
            put(scans, &scan)?;
        }
        let due = Duration::from_secs_f64(time_s / speedup);
        std::thread::sleep(due.saturating_sub(pace.elapsed()));
    }
    Ok(())
}

fn main() -> Result<(), Failure> {
    let mut given = std::env::args().skip(1);
    let mut next = |default: &str| given.next().unwrap_or_else(|| default.to_owned());
    let (endpoint, robot) = (next("tcp/127.0.0.1:7447"), next("tugger_01"));
    let (seconds, speedup): (u32, f64) = (next("120").parse()?, next("1").parse()?);
    let samples_max: usize = next("10").parse()?;
    let config = json!({ "mode": "client", "connect": { "endpoints": [endpoint] } });
    let session = zenoh::open(Config::from_json5(&config.to_string())?).wait()?;
    let declare = |stream, of: &str| {
        let publisher = session.declare_publisher(format!("fleet/{robot}/{stream}"));
        publisher
            .encoding(Encoding::APPLICATION_JSON.with_schema(of))
            .wait()
    };
    let mut drives = Drives {
        publisher: declare("wheel_odometry", "fleetcal_msgs/msg/DriveSamples")?,
        samples: Vec::new(),
        samples_max,
    };
    let alive = format!("fleet/@alive/{robot}");
    let token = session.liveliness().declare_token(alive).wait()?;
    drive(
        &mut drives,
        &declare("scan", "sensor_msgs/msg/LaserScan")?,
        100 * seconds,
        speedup,
    )?;
    token.undeclare().wait()?;
    session.close().wait()
}
