//! `fleetcal_msgs/msg/DriveSamples`: several drive samples in one message, so that a robot does not
//! publish each by itself.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{RosMessage, Time, serde_forms};
use crate::cdr::{CdrError, CdrReader, CdrWriter};

/// Most drive samples in one message: 100 ms of them at 250 Hz.
pub const DRIVE_SAMPLES_MAX: usize = 25;
/// Longest time from the first drive sample of a message to its last, ns.
pub const DRIVE_SAMPLES_SPAN_MAX_NS: i64 = 100_000_000;
/// Bytes of one drive sample in CDR.
const SAMPLE_BYTES: usize = 16;

/// Drive sample as it was measured: it describes the interval that ends at its stamp.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeasuredDrive {
    /// Stamp at the end of the interval.
    pub stamp: Time,
    /// Angle of the (virtual) centre wheel, rad, left positive.
    pub steering_angle: f32,
    /// Forward speed, m/s, negative in reverse.
    pub speed: f32,
}

/// Drive samples of one message: at least one, at most [`DRIVE_SAMPLES_MAX`], finite, with stamps
/// that ascend and span at most [`DRIVE_SAMPLES_SPAN_MAX_NS`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Unchecked")]
pub struct DriveSamples {
    samples: Vec<MeasuredDrive>,
}

/// Samples of a message before they are checked.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Unchecked {
    #[serde(deserialize_with = "serde_forms::at_most::<_, DRIVE_SAMPLES_MAX, _>")]
    samples: Vec<MeasuredDrive>,
}

/// Reason for which samples do not make a message.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum SamplesRefused {
    /// There is no sample, or there are too many.
    #[error("samples: got {0} of them, expected 1 to {DRIVE_SAMPLES_MAX}")]
    Count(usize),
    /// A stamp does not come after the one before it.
    #[error(
        "samples[{index}].stamp: got {stamp_ns} ns, expected more than that of the sample before, \
         {before_ns} ns"
    )]
    Order {
        /// Place of the sample.
        index: usize,
        /// Its stamp, ns since 1970.
        stamp_ns: i64,
        /// Stamp before it, ns since 1970.
        before_ns: i64,
    },
    /// A stamp is too far from the first.
    #[error(
        "samples[{index}].stamp: got {after_ns} ns after the first, expected at most \
         {DRIVE_SAMPLES_SPAN_MAX_NS} ns"
    )]
    Span {
        /// Place of the sample.
        index: usize,
        /// Time from the first stamp, ns.
        after_ns: i64,
    },
    /// A value is not a finite number.
    #[error("samples[{index}].{field}: got {value}, expected a finite number")]
    NotFinite {
        /// Place of the sample.
        index: usize,
        /// Name of the field.
        field: &'static str,
        /// Value of the field.
        value: String,
    },
}

impl DriveSamples {
    /// Checks samples and makes them a message.
    ///
    /// # Errors
    /// Names the sample and the field that contradict [`DriveSamples`].
    pub fn new(samples: Vec<MeasuredDrive>) -> Result<Self, SamplesRefused> {
        let first_ns = match samples.as_slice() {
            [first, ..] if samples.len() <= DRIVE_SAMPLES_MAX => first.stamp.as_ns(),
            _ => return Err(SamplesRefused::Count(samples.len())),
        };
        let mut before_ns = None;
        for (index, sample) in samples.iter().enumerate() {
            let stamp_ns = sample.stamp.as_ns();
            if let Some(before_ns) = before_ns.replace(stamp_ns)
                && stamp_ns <= before_ns
            {
                return Err(SamplesRefused::Order {
                    index,
                    stamp_ns,
                    before_ns,
                });
            }
            let after_ns = stamp_ns - first_ns;
            if after_ns > DRIVE_SAMPLES_SPAN_MAX_NS {
                return Err(SamplesRefused::Span { index, after_ns });
            }
            let fields = [
                ("steering_angle", sample.steering_angle),
                ("speed", sample.speed),
            ];
            if let Some((field, value)) = fields.into_iter().find(|(_, value)| !value.is_finite()) {
                return Err(SamplesRefused::NotFinite {
                    index,
                    field,
                    value: value.to_string(),
                });
            }
        }
        Ok(Self { samples })
    }

    /// Returns the samples, in the order of their stamps.
    pub fn samples(&self) -> &[MeasuredDrive] {
        &self.samples
    }
}

impl TryFrom<Unchecked> for DriveSamples {
    type Error = SamplesRefused;

    fn try_from(unchecked: Unchecked) -> Result<Self, SamplesRefused> {
        Self::new(unchecked.samples)
    }
}

impl RosMessage for DriveSamples {
    const TYPE: &'static str = "fleetcal_msgs/msg/DriveSamples";

    fn read(mut reader: CdrReader<'_>) -> Result<Self, CdrError> {
        let read = |reader: &mut CdrReader<'_>| {
            Ok(MeasuredDrive {
                stamp: Time::read(reader, "samples.stamp.sec", "samples.stamp.nanosec")?,
                steering_angle: reader.f32("samples.steering_angle")?,
                speed: reader.f32("samples.speed")?,
            })
        };
        let samples = reader.sequence("samples", SAMPLE_BYTES, DRIVE_SAMPLES_MAX, read)?;
        reader.finish("samples")?;
        Self::new(samples).map_err(|refused| CdrError::Contents(refused.to_string()))
    }

    fn write(&self, writer: &mut CdrWriter) {
        writer.sequence_length(self.samples.len());
        for sample in &self.samples {
            writer.i32(sample.stamp.sec);
            writer.u32(sample.stamp.nanosec);
            writer.f32(sample.steering_angle);
            writer.f32(sample.speed);
        }
    }

    fn body_bytes(&self) -> usize {
        4 + SAMPLE_BYTES * self.samples.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sample `ms` milliseconds after a whole second.
    fn sample(ms: u32) -> MeasuredDrive {
        MeasuredDrive {
            stamp: Time {
                sec: 1_760_000_000,
                nanosec: ms * 1_000_000,
            },
            steering_angle: 0.25,
            speed: -1.5,
        }
    }

    fn samples(ms: impl IntoIterator<Item = u32>) -> DriveSamples {
        DriveSamples::new(ms.into_iter().map(sample).collect()).unwrap()
    }

    #[test]
    fn the_layout_is_the_documented_one() {
        let bytes = samples([0, 10]).to_cdr();
        let mut expected = vec![0, 1, 0, 0, 2, 0, 0, 0];
        for nanosec in [0_u32, 10_000_000] {
            expected.extend(1_760_000_000_i32.to_le_bytes());
            expected.extend(nanosec.to_le_bytes());
            expected.extend(0.25_f32.to_le_bytes());
            expected.extend((-1.5_f32).to_le_bytes());
        }
        assert_eq!(bytes, expected);
        let json = String::from_utf8(samples([10]).to_json().unwrap()).unwrap();
        assert_eq!(
            json,
            r#"{"samples":[{"stamp":{"sec":1760000000,"nanosec":10000000},"steering_angle":0.25,"speed":-1.5}]}"#
        );
    }

    #[test]
    fn the_limits_are_accepted_and_come_back() {
        for message in [samples([5]), samples(0..25), samples([0, 100])] {
            let cdr = DriveSamples::from_cdr(&message.to_cdr()).unwrap();
            let json = DriveSamples::from_json(&message.to_json().unwrap()).unwrap();
            assert_eq!((&cdr, &json), (&message, &message));
        }
    }

    #[test]
    fn each_refusal_names_the_sample_and_the_field_in_both_forms() {
        let with = |change: fn(&mut MeasuredDrive)| {
            let mut changed = sample(10);
            change(&mut changed);
            vec![sample(0), changed]
        };
        let cases = [
            (vec![], "samples: got 0 of them, expected 1 to 25"),
            (
                vec![sample(10), sample(10)],
                "samples[1].stamp: got 1760000000010000000 ns, expected more than",
            ),
            (
                vec![sample(0), sample(20), sample(10)],
                "samples[2].stamp: got 1760000000010000000 ns",
            ),
            (
                vec![sample(0), sample(50), sample(101)],
                "samples[2].stamp: got 101000000 ns after the first, expected at most 100000000",
            ),
            (
                with(|sample| sample.speed = f32::INFINITY),
                "samples[1].speed: got inf, expected a finite number",
            ),
            (
                with(|sample| sample.steering_angle = f32::NAN),
                "samples[1].steering_angle: got NaN",
            ),
        ];
        for (samples, wanted) in cases {
            let refused = DriveSamples::new(samples.clone()).unwrap_err().to_string();
            assert!(refused.starts_with(wanted), "{refused}");
            let wrong = DriveSamples { samples };
            let cdr = DriveSamples::from_cdr(&wrong.to_cdr()).unwrap_err();
            let cdr = cdr.to_string();
            assert!(cdr.contains(wanted), "{cdr}");
            // JSON has no infinity: the number is missing there.
            if let Ok(json) = wrong.to_json()
                && !wanted.contains("inf")
                && !wanted.contains("NaN")
            {
                let json = DriveSamples::from_json(&json).unwrap_err().to_string();
                assert!(json.contains(wanted), "{json}");
            }
        }
        let long = DriveSamples {
            samples: vec![sample(0); 26],
        };
        let cdr = DriveSamples::from_cdr(&long.to_cdr()).unwrap_err();
        assert!(cdr.to_string().contains("samples claims 26 elements"));
        let json = DriveSamples::from_json(&long.to_json().unwrap()).unwrap_err();
        let json = json.to_string();
        assert!(json.contains("samples") && json.contains("26"), "{json}");
    }
}
