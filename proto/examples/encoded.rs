//! Reads messages that other encoders wrote, and writes them back: every byte has to be the same.
//!
//! `encoded FILE`: the file is what `tests/encoders/encoders.py` writes.

use std::collections::BTreeMap;
use std::process::ExitCode;

use fleetcal_proto::message_type::MessageType;
use fleetcal_proto::ros::{
    AckermannDrive, AckermannDriveStamped, DriveSamples, DynamicJointState, Float32, Float64,
    JointState, LaserScan, MultiEchoLaserScan, Odometry, PointCloud2, PoseStamped, RosMessage,
    SteeringControllerStatus, SteeringReport, TwistStamped, TwistWithCovarianceStamped,
    VelocityReport, VescStateStamped,
};

const ENCODERS: [&str; 2] = ["rosbags", "pycdr2"];

#[derive(Debug, Default)]
struct Tally {
    messages: u64,
    accepted: u64,
    same: u64,
    first_refusal: Option<String>,
}

/// Reads the message and writes it back; returns the reason if it is refused.
fn rewritten(of: MessageType, payload: &[u8]) -> Result<Vec<u8>, String> {
    fn both_ways<M: RosMessage>(payload: &[u8]) -> Result<Vec<u8>, String> {
        let message = M::from_cdr(payload).map_err(|refused| refused.to_string())?;
        Ok(message.to_cdr())
    }
    match of {
        MessageType::AckermannDriveStamped => both_ways::<AckermannDriveStamped>(payload),
        MessageType::DriveSamples => both_ways::<DriveSamples>(payload),
        MessageType::JointState => both_ways::<JointState>(payload),
        MessageType::Odometry => both_ways::<Odometry>(payload),
        MessageType::TwistStamped => both_ways::<TwistStamped>(payload),
        MessageType::PoseStamped => both_ways::<PoseStamped>(payload),
        MessageType::LaserScan => both_ways::<LaserScan>(payload),
        MessageType::PointCloud2 => both_ways::<PointCloud2>(payload),
        MessageType::AckermannDrive => both_ways::<AckermannDrive>(payload),
        MessageType::DynamicJointState => both_ways::<DynamicJointState>(payload),
        MessageType::SteeringControllerStatus => both_ways::<SteeringControllerStatus>(payload),
        MessageType::TwistWithCovarianceStamped => both_ways::<TwistWithCovarianceStamped>(payload),
        MessageType::SteeringReport => both_ways::<SteeringReport>(payload),
        MessageType::VelocityReport => both_ways::<VelocityReport>(payload),
        MessageType::VescStateStamped => both_ways::<VescStateStamped>(payload),
        MessageType::Float32 => both_ways::<Float32>(payload),
        MessageType::Float64 => both_ways::<Float64>(payload),
        MessageType::MultiEchoLaserScan => both_ways::<MultiEchoLaserScan>(payload),
    }
}

/// Splits `count` bytes off the front.
fn take<'b>(rest: &mut &'b [u8], count: usize) -> Option<&'b [u8]> {
    let (front, behind) = rest.split_at_checked(count)?;
    *rest = behind;
    Some(front)
}

/// Reads one record: type, encoder, message.
fn record<'b>(rest: &mut &'b [u8]) -> Option<(MessageType, &'static str, &'b [u8])> {
    let name_bytes = usize::from(*take(rest, 1)?.first()?);
    let name = std::str::from_utf8(take(rest, name_bytes)?).ok()?;
    let encoder = *take(rest, 1)?.first()?;
    let length = u32::from_le_bytes(take(rest, 4)?.try_into().ok()?);
    let payload = take(rest, length as usize)?;
    let of = MessageType::of_ros_type(name)?;
    Some((of, *ENCODERS.get(usize::from(encoder))?, payload))
}

#[expect(clippy::print_stdout, reason = "a table for whoever calls it")]
fn main() -> ExitCode {
    let Some(path) = std::env::args().nth(1) else {
        eprintln!("encoded FILE");
        return ExitCode::from(2);
    };
    let bytes = match std::fs::read(&path) {
        Ok(bytes) => bytes,
        Err(error) => {
            eprintln!("{path}: {error}");
            return ExitCode::from(74);
        }
    };
    let mut rest = bytes.as_slice();
    let mut tallies: BTreeMap<(MessageType, &str), Tally> = BTreeMap::new();
    while !rest.is_empty() {
        let Some((of, encoder, payload)) = record(&mut rest) else {
            eprintln!("{path}: a record is not whole");
            return ExitCode::from(65);
        };
        let tally = tallies.entry((of, encoder)).or_default();
        tally.messages += 1;
        match rewritten(of, payload) {
            Ok(written) => {
                tally.accepted += 1;
                tally.same += u64::from(written == payload);
            }
            Err(refused) => {
                tally.first_refusal.get_or_insert(refused);
            }
        }
    }
    println!("type                                     encoder  messages  accepted  same bytes");
    let mut all = !tallies.is_empty();
    for ((of, encoder), tally) in &tallies {
        let Tally {
            messages,
            accepted,
            same,
            first_refusal,
        } = tally;
        println!(
            "{:<40} {encoder:<8} {messages:>8} {accepted:>9} {same:>11}",
            of.ros_type()
        );
        if let Some(refusal) = first_refusal {
            println!("    first refusal: {refusal}");
        }
        all &= accepted == messages && same == messages;
    }
    if all {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}
