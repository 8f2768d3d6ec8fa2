//! Recordings of robots with a 3D scanner, made of those of robots with a planar one.

use std::path::Path;

use fleetcal_proto::ros::{LaserScan, PointCloud2, PointDatatype, PointField, RosMessage};

use crate::rewritten::{Rewritten, rewritten};

/// Elevations of the scanner's rings, degrees.
const RINGS_DEG: [f64; 8] = [-15.0, -10.0, -6.0, -3.0, -1.0, 1.0, 4.0, 12.0];
/// Heights of the floor and of the ceiling from the LiDAR, m.
const FLOOR_M: f64 = -0.5;
const CEILING_M: f64 = 4.0;
/// Number of the planar scanner's beams in a column.
const BEAMS_A_COLUMN: usize = 2;

/// Writes a recording's messages as `path`, its scans as the clouds of a scanner of eight rings:
/// walls from the floor to the ceiling, where the scan had returns.
///
/// # Panics
/// When it cannot be written.
pub fn of_scans(recording: &Path, path: &Path) {
    rewritten(recording, path, |message_type, of| {
        if message_type != LaserScan::TYPE {
            return vec![Rewritten::unchanged(message_type, of)];
        }
        let scan = LaserScan::from_cdr(&of.payload).expect("a scan");
        vec![Rewritten::on(&of.topic, of, &cloud(&scan))]
    });
}

/// Makes the cloud of a turn: ring after ring, each point with its time.
fn cloud(scan: &LaserScan) -> PointCloud2 {
    let beams = || scan.ranges.iter().enumerate().step_by(BEAMS_A_COLUMN);
    let mut data = Vec::new();
    for ring_deg in RINGS_DEG {
        let slope = ring_deg.to_radians().tan();
        let flat_m = if slope < 0.0 { FLOOR_M } else { CEILING_M } / slope;
        for (beam, &range) in beams() {
            let azimuth = f64::from(scan.angle_min) + beam as f64 * f64::from(scan.angle_increment);
            let is_return = (scan.range_min..=scan.range_max).contains(&range);
            let wall_m = if is_return {
                f64::from(range)
            } else {
                f64::INFINITY
            };
            let level_m = wall_m.min(flat_m);
            let position = [
                level_m * azimuth.cos(),
                level_m * azimuth.sin(),
                level_m * slope,
            ];
            let time_s = beam as f32 * scan.time_increment;
            let numbers = position.map(|metres| metres as f32);
            data.extend(numbers.into_iter().flat_map(f32::to_le_bytes));
            data.extend(time_s.to_le_bytes());
        }
    }
    let fields = ["x", "y", "z", "time"].into_iter().zip((0..).step_by(4));
    let width = beams().count() as u32;
    PointCloud2 {
        header: scan.header.clone(),
        height: RINGS_DEG.len() as u32,
        width,
        fields: fields
            .map(|(name, offset)| PointField {
                name: name.to_owned(),
                offset,
                datatype: PointDatatype::Float32,
                count: 1,
            })
            .collect(),
        is_bigendian: false,
        point_step: 16,
        row_step: 16 * width,
        data: data.into(),
        is_dense: false,
    }
}
