//! Single imperfections by name, at their typical and strong size, and all of them at once.

use std::f64::consts::PI;

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::Imperfections;
use crate::simulator::random::{Stream, stream};

/// Strength of an imperfection.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Strength {
    /// Typical of a robot in good order.
    Typical,
    /// Three times that.
    Strong,
}

impl Strength {
    /// Both strengths.
    pub const ALL: [Self; 2] = [Self::Typical, Self::Strong];

    /// Returns the multiple of the typical size.
    pub const fn times(self) -> f64 {
        match self {
            Self::Typical => 1.0,
            Self::Strong => 3.0,
        }
    }

    /// Returns its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Typical => "typical",
            Self::Strong => "strong",
        }
    }
}

/// Kind of an imperfection. `docs/assumptions.md` gives the source of each typical size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ImperfectionKind {
    /// Steering gain, 1 %.
    SteeringGain,
    /// Left/right asymmetry of the steering, 1 % to either side.
    SteeringAsymmetry,
    /// Quadratic term of the steering, 0.3° at 20°.
    SteeringQuadratic,
    /// Cubic term of the steering, 0.3° at 20°.
    SteeringCubic,
    /// Play between steering sensor and wheel, 0.5°.
    Backlash,
    /// The wheel follows the shown angle with a time constant of 100 ms.
    SteeringLag,
    /// The shown angle is 100 ms late.
    SteeringDelay,
    /// Steps of 0.25° of the steering encoder, without anything that makes the wheel tremble.
    EncoderSteps,
    /// Configured wheelbase, 2 %.
    Wheelbase,
    /// Unequal wheels, 1 % to either side.
    WheelSizes,
    /// Speed measured 5 cm beside the axle's middle.
    SpeedEncoder,
    /// Side slip, 0.004 rad for each m/s².
    SideSlip,
    /// Understeer, 0.004 rad for each m/s².
    Understeer,
    /// Range bias, 3 cm.
    RangeBias,
    /// Bias by angle of incidence, 1 cm at 60°.
    IncidenceBias,
    /// Rotating scanner at 10 Hz that sends `time_increment` 0.
    #[serde(rename = "untimed_10hz")]
    Untimed10Hz,
    /// Rotating scanner at 40 Hz that sends `time_increment` 0.
    #[serde(rename = "untimed_40hz")]
    Untimed40Hz,
    /// Scans stamped at their end.
    StampedAtEnd,
    /// Five scans in a second.
    #[serde(rename = "scan_rate_5hz")]
    ScanRate5Hz,
    /// Forty scans in a second.
    #[serde(rename = "scan_rate_40hz")]
    ScanRate40Hz,
    /// Clock of the wheel odometry against the LiDAR's, 100 ppm.
    ClockDrift,
    /// Jitter of all stamps, 5 ms.
    StampJitter,
    /// Lost messages, 10 %.
    Losses,
    /// Mixed pixels at three edges of ten.
    MixedPixels,
    /// Tilt of the scanning plane, 1°.
    Tilt,
    /// Range scale, 0.5 %.
    RangeScale,
}

impl ImperfectionKind {
    /// All kinds.
    pub const ALL: [Self; 26] = [
        Self::SteeringGain,
        Self::SteeringAsymmetry,
        Self::SteeringQuadratic,
        Self::SteeringCubic,
        Self::Backlash,
        Self::SteeringLag,
        Self::SteeringDelay,
        Self::EncoderSteps,
        Self::Wheelbase,
        Self::WheelSizes,
        Self::SpeedEncoder,
        Self::SideSlip,
        Self::Understeer,
        Self::RangeBias,
        Self::IncidenceBias,
        Self::Untimed10Hz,
        Self::Untimed40Hz,
        Self::StampedAtEnd,
        Self::ScanRate5Hz,
        Self::ScanRate40Hz,
        Self::ClockDrift,
        Self::StampJitter,
        Self::Losses,
        Self::MixedPixels,
        Self::Tilt,
        Self::RangeScale,
    ];

    /// Returns its name: `steering_gain` and so on.
    pub const fn name(self) -> &'static str {
        match self {
            Self::SteeringGain => "steering_gain",
            Self::SteeringAsymmetry => "steering_asymmetry",
            Self::SteeringQuadratic => "steering_quadratic",
            Self::SteeringCubic => "steering_cubic",
            Self::Backlash => "backlash",
            Self::SteeringLag => "steering_lag",
            Self::SteeringDelay => "steering_delay",
            Self::EncoderSteps => "encoder_steps",
            Self::Wheelbase => "wheelbase",
            Self::WheelSizes => "wheel_sizes",
            Self::SpeedEncoder => "speed_encoder",
            Self::SideSlip => "side_slip",
            Self::Understeer => "understeer",
            Self::RangeBias => "range_bias",
            Self::IncidenceBias => "incidence_bias",
            Self::Untimed10Hz => "untimed_10hz",
            Self::Untimed40Hz => "untimed_40hz",
            Self::StampedAtEnd => "stamped_at_end",
            Self::ScanRate5Hz => "scan_rate_5hz",
            Self::ScanRate40Hz => "scan_rate_40hz",
            Self::ClockDrift => "clock_drift",
            Self::StampJitter => "stamp_jitter",
            Self::Losses => "losses",
            Self::MixedPixels => "mixed_pixels",
            Self::Tilt => "tilt",
            Self::RangeScale => "range_scale",
        }
    }

    /// Returns the kind of a name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// True if it acts on beams, so that a robot has to send scans to show it.
    pub const fn needs_scans(self) -> bool {
        matches!(
            self,
            Self::RangeBias
                | Self::IncidenceBias
                | Self::Untimed10Hz
                | Self::Untimed40Hz
                | Self::StampedAtEnd
                | Self::MixedPixels
                | Self::Tilt
        )
    }

    /// True if it has a size. A scanner that sends no beam times, stamps at the end or has another
    /// rate has none: its strong form is its typical one.
    pub const fn has_size(self) -> bool {
        !matches!(
            self,
            Self::Untimed10Hz
                | Self::Untimed40Hz
                | Self::StampedAtEnd
                | Self::ScanRate5Hz
                | Self::ScanRate40Hz
        )
    }
}

impl Imperfections {
    /// Makes one imperfection at its typical size.
    pub fn typical(kind: ImperfectionKind) -> Self {
        Self::single(kind, Strength::Typical.times())
    }

    /// Makes one imperfection at three times its typical size.
    pub fn strong(kind: ImperfectionKind) -> Self {
        Self::single(kind, Strength::Strong.times())
    }

    /// Makes one imperfection at a multiple of its typical size; a negative number inverts its
    /// sign, if it has one.
    pub fn single(kind: ImperfectionKind, times: f64) -> Self {
        let mut one = Self::default();
        one.add(kind, times);
        one
    }

    /// Makes one imperfection of exactly that strength, with the sign (and a tilt's direction)
    /// drawn from the seed.
    pub fn drawn(kind: ImperfectionKind, strength: Strength, seed: u64) -> Self {
        let mut random = imperfection_stream(seed);
        let mut one = Self::single(kind, strength.times() * sign(&mut random));
        if kind == ImperfectionKind::Tilt {
            one.scanner.tilt_direction_rad = random.random_range(-PI..PI);
        }
        one
    }

    /// Makes every imperfection at once: each of half to one and a half times its typical size, its
    /// sign drawn. The scan rate is between 5 and 40 Hz; every other robot leaves out the beams'
    /// times, every other one stamps at the scan's end, and the steering either lags or is late.
    /// Without `scans` those of beams are left out.
    pub fn all_typical(seed: u64, scans: bool) -> Self {
        let mut random = imperfection_stream(seed);
        let mut all = Self::default();
        for kind in ImperfectionKind::ALL {
            // The same draws for every kind, so that a new one changes none of those before it.
            let (size, sign) = (random.random_range(0.5..1.5), sign(&mut random));
            let shown = scans || !kind.needs_scans();
            if kind.has_size() && shown {
                all.add(kind, size * sign);
            }
        }
        all.lidar.scan_rate_hz = Some(5.0 * 8f64.powf(random.random_range(0.0..1.0)));
        let (untimed, at_end) = (random.random(), random.random());
        let tilt_direction_rad = random.random_range(-PI..PI);
        if random.random() {
            all.vehicle.steering_lag_s = 0.0;
        } else {
            all.vehicle.steering_delay_s = 0.0;
        }
        if scans {
            all.scanner.untimed_beams = untimed;
            all.scanner.stamped_at_end = at_end;
            all.scanner.tilt_direction_rad = tilt_direction_rad;
        }
        all
    }

    fn add(&mut self, kind: ImperfectionKind, times: f64) {
        use ImperfectionKind as Kind;
        let size = times.abs();
        let (vehicle, scanner) = (&mut self.vehicle, &mut self.scanner);
        match kind {
            Kind::SteeringGain => vehicle.steering_gain = 0.01 * times,
            Kind::SteeringAsymmetry => vehicle.steering_asymmetry = 0.01 * times,
            Kind::SteeringQuadratic => {
                vehicle.steering_quadratic_rad = 0.3_f64.to_radians() * times;
            }
            Kind::SteeringCubic => vehicle.steering_cubic_rad = 0.3_f64.to_radians() * times,
            Kind::Backlash => vehicle.backlash_rad = 0.5_f64.to_radians() * size,
            Kind::SteeringLag => vehicle.steering_lag_s = 0.1 * size,
            Kind::SteeringDelay => vehicle.steering_delay_s = 0.1 * size,
            Kind::EncoderSteps => vehicle.undithered_step_rad = 0.25_f64.to_radians() * size,
            Kind::Wheelbase => vehicle.wheelbase = 0.02 * times,
            Kind::WheelSizes => vehicle.wheel_sizes = 0.01 * times,
            Kind::SpeedEncoder => vehicle.speed_encoder_y_m = 0.05 * times,
            Kind::SideSlip => vehicle.side_slip_rad_per_mps2 = 0.004 * size,
            Kind::Understeer => vehicle.understeer_rad_per_mps2 = 0.004 * size,
            Kind::RangeBias => scanner.range_bias_m = 0.03 * times,
            Kind::IncidenceBias => scanner.incidence_bias_m = 0.01 * times,
            Kind::Untimed10Hz => self.add_untimed(10.0),
            Kind::Untimed40Hz => self.add_untimed(40.0),
            Kind::StampedAtEnd => scanner.stamped_at_end = true,
            Kind::ScanRate5Hz => self.lidar.scan_rate_hz = Some(5.0),
            Kind::ScanRate40Hz => self.lidar.scan_rate_hz = Some(40.0),
            Kind::ClockDrift => self.clocks.drive_drift = 1e-4 * times,
            Kind::StampJitter => self.clocks.stamp_jitter_s = 0.005 * size,
            Kind::Losses => self.clocks.lost_messages = 0.1 * size,
            Kind::MixedPixels => scanner.mixed_pixels = 0.3 * size,
            Kind::Tilt => scanner.tilt_rad = 1f64.to_radians() * size,
            Kind::RangeScale => self.lidar.range_scale = 0.005 * times,
        }
    }

    fn add_untimed(&mut self, rate_hz: f64) {
        self.scanner.untimed_beams = true;
        self.lidar.scan_rate_hz = Some(rate_hz);
    }
}

fn imperfection_stream(seed: u64) -> ChaCha8Rng {
    stream(seed, Stream::Imperfections)
}

fn sign(random: &mut ChaCha8Rng) -> f64 {
    if random.random() { 1.0 } else { -1.0 }
}
