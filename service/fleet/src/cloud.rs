//! Conversion of a 3D scanner's clouds into the scans of a planar one.

use fleetcal_estimator::point_cloud::{CloudPoint, PlanarBand, PointCloud};
use fleetcal_estimator::stream::FieldRefused;
use fleetcal_estimator::{RobotTime, Scan};
use fleetcal_proto::ros::{CloudRefused, Column, PointCloud2, PointDatatype};
use thiserror::Error;

/// Field names that drivers use for a point's time.
const TIME_FIELDS: [&str; 5] = ["t", "time", "timestamp", "time_stamp", "offset_time"];
/// Times above this are seconds since 1970, s.
const SINCE_1970_S: f64 = 1e8;
/// Times above this are nanoseconds since 1970, ns.
const SINCE_1970_NS: f64 = 1e17;

/// Reason for which a cloud was refused.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum CloudUnusable {
    /// The cloud contradicts itself or lacks a coordinate.
    #[error(transparent)]
    Layout(#[from] CloudRefused),
    /// The cloud cannot be made into a scan.
    #[error(transparent)]
    Field(#[from] FieldRefused),
}

/// Makes the planar scan of a cloud.
///
/// # Errors
/// Names the field that contradicts the others, is missing, or holds an impossible value.
pub fn scan(message: &PointCloud2, band: &PlanarBand) -> Result<Scan, CloudUnusable> {
    message.check_layout()?;
    let position = [
        message.needed_column("x")?,
        message.needed_column("y")?,
        message.needed_column("z")?,
    ];
    let stamp = RobotTime(message.header.stamp.as_ns());
    let time = TIME_FIELDS.iter().find_map(|name| message.column(name));
    let points = message.points().map(|point| CloudPoint {
        position_m: position.map(|column| column.read(point) as f32),
        time_s: time.map_or(0.0, |column| seconds_after(stamp, column, point) as f32),
    });
    // Rings and directions may be rows or columns; of directions there are more.
    let is_organised = message.width > 1 && message.height > 1;
    let cloud = PointCloud {
        stamp,
        points: points.collect(),
        columns: is_organised.then_some(message.width.max(message.height) as usize),
    };
    Ok(band.scan(&cloud)?)
}

/// Reads a point's time, in seconds after the cloud's stamp: integers are nanoseconds, other
/// numbers seconds; both may also count from 1970.
fn seconds_after(stamp: RobotTime, column: Column, point: &[u8]) -> f64 {
    let time = column.read(point);
    if time > SINCE_1970_NS {
        return (time - stamp.0 as f64) * 1e-9;
    }
    if time > SINCE_1970_S && column.datatype() == PointDatatype::Float64 {
        return time - stamp.0 as f64 * 1e-9;
    }
    match column.datatype() {
        PointDatatype::Float32 | PointDatatype::Float64 => time,
        _ => time * 1e-9,
    }
}

#[cfg(test)]
mod tests {
    use fleetcal_domain::robot::ScanSettings;
    use fleetcal_model::Stream;
    use fleetcal_proto::encoding::Encoding;
    use fleetcal_proto::message_type::{Form, MessageType, ScanType};
    use fleetcal_proto::ros::{Header, PointField, RosMessage, Time};

    use super::*;
    use crate::reading::ReadingSettings;
    use crate::reading::testing::{decoded, decoded_by};

    const STAMP: Time = Time {
        sec: 1_700_000_000,
        nanosec: 250_000_000,
    };

    /// Makes a cloud with times: a ring of 360 points at 4 m, and another half a metre higher at 5
    /// m.
    fn cloud(time_name: &str, time_type: PointDatatype, time: impl Fn(f64) -> f64) -> PointCloud2 {
        let mut data = Vec::new();
        for (z, range) in [(0.0_f32, 4.0_f64), (0.6, 5.0)] {
            for degree in 0..360 {
                let (s, c) = f64::from(degree).to_radians().sin_cos();
                for coordinate in [(range * c) as f32, (range * s) as f32, z] {
                    data.extend(coordinate.to_le_bytes());
                }
                let time = time(0.1 * f64::from(degree) / 360.0);
                match time_type {
                    PointDatatype::Uint32 => data.extend((time as u32).to_le_bytes()),
                    PointDatatype::Float32 => data.extend((time as f32).to_le_bytes()),
                    _ => data.extend(time.to_le_bytes()),
                }
            }
        }
        let step = 12 + time_type.bytes() as u32;
        let field = |(name, offset, datatype): (&str, u32, PointDatatype)| PointField {
            name: name.to_owned(),
            offset,
            datatype,
            count: 1,
        };
        let float = PointDatatype::Float32;
        let fields = [
            ("x", 0, float),
            ("y", 4, float),
            ("z", 8, float),
            (time_name, 12, time_type),
        ];
        PointCloud2 {
            header: Header {
                stamp: STAMP,
                frame_id: "lidar".to_owned(),
            },
            height: 2,
            width: 360,
            fields: fields.map(field).into(),
            is_bigendian: false,
            point_step: step,
            row_step: 360 * step,
            data: data.into(),
            is_dense: true,
        }
    }

    #[test]
    fn times_of_every_driver_make_the_same_rolling_scan() {
        let stamp_s = STAMP.as_ns() as f64 * 1e-9;
        let clouds = [
            cloud("t", PointDatatype::Uint32, |t| (t * 1e9).round()),
            cloud("offset_time", PointDatatype::Uint32, |t| (t * 1e9).round()),
            cloud("time_stamp", PointDatatype::Uint32, |t| (t * 1e9).round()),
            cloud("time", PointDatatype::Float32, |t| t),
            cloud("timestamp", PointDatatype::Float64, |t| t + stamp_s),
            cloud("timestamp", PointDatatype::Float64, |t| (t + stamp_s) * 1e9),
        ];
        for cloud in clouds {
            let scan = scan(&cloud, &PlanarBand::default()).expect("a turning scanner");
            assert_eq!(scan.ranges_m().len(), 360);
            assert!(
                scan.ranges_m()
                    .iter()
                    .all(|range| (range - 4.0).abs() < 1e-3)
            );
            assert!((scan.shape().time_increment_s * 360.0 - 0.1).abs() < 1e-4);
            let off_s = scan.stamp().seconds_since(RobotTime(STAMP.as_ns()));
            assert!(off_s.abs() < 1e-3, "{off_s}");
            assert!(!scan.lacks_beam_times());
        }
        let untimed = cloud("intensity", PointDatatype::Float32, |t| t);
        let scan = scan(&untimed, &PlanarBand::default()).expect("taken at once");
        assert!(scan.shape().time_increment_s.abs() < 1e-12);
        assert!(scan.lacks_beam_times());
    }

    #[test]
    fn a_cloud_comes_by_its_schema_or_by_configuration() {
        let payload = cloud("time", PointDatatype::Float32, |t| t).to_cdr();
        let plain = Form::from(Encoding::Cdr);
        let named = Form::parse("application/cdr;sensor_msgs/msg/PointCloud2").expect("known");
        let reason = decoded(Stream::Scan, plain, &payload).expect_err("no scan");
        assert!(
            reason.to_string().contains("sensor_msgs/msg/LaserScan"),
            "{reason}"
        );
        let named = decoded(Stream::Scan, named, &payload).expect("a cloud");
        let scans = ScanSettings {
            scan_type: ScanType::PointCloud2,
            ..ScanSettings::default()
        };
        let configured = ReadingSettings {
            scans,
            ..ReadingSettings::default()
        };
        let again = decoded_by(&configured, Stream::Scan, plain, &payload).expect("a cloud");
        assert_eq!(named.event, again.event);
        assert_eq!(named.stamp, RobotTime(STAMP.as_ns()));
    }

    #[test]
    fn what_cannot_be_is_refused_by_field() {
        let whole = || cloud("time", PointDatatype::Float32, |t| t);
        let refusal = |change: &dyn Fn(&mut PointCloud2)| {
            let mut cloud = whole();
            change(&mut cloud);
            let form = Form {
                encoding: Encoding::Cdr,
                message_type: Some(MessageType::PointCloud2),
            };
            decoded(Stream::Scan, form, &cloud.to_cdr())
                .expect_err("must be refused")
                .to_string()
        };
        let reason = refusal(&|cloud| cloud.fields.retain(|field| field.name != "z"));
        assert!(
            reason.starts_with("scan: fields: got [x, y, time]"),
            "{reason}"
        );
        let reason = refusal(&|cloud| cloud.row_step = 7);
        assert!(reason.starts_with("scan: row_step: got 7"), "{reason}");
        let reason = refusal(&|cloud| cloud.header.stamp = Time::default());
        assert!(reason.contains("header.stamp"), "{reason}");
    }
}
