use std::f64::consts::{PI, TAU};

use super::*;

const STAMP: RobotTime = RobotTime(1_700_000_000_000_000_000);
const FLOOR_M: f64 = -0.4;
const CEILING_M: f64 = 3.0;

/// View of a room by a scanner of 32 rings from −16 to 15 degrees.
#[derive(Clone, Copy)]
struct View {
    columns: usize,
    /// Degrees that the scanner leans forward.
    lean_deg: f64,
    /// −1 for a scanner that turns clockwise.
    sense: f64,
    /// Direction of the first column, rad.
    first_rad: f64,
    /// Time of a turn, s; 0: taken at once.
    period_s: f64,
    has_floor: bool,
}

const LEVEL: View = View {
    columns: 512,
    lean_deg: 0.0,
    sense: 1.0,
    first_rad: -PI,
    period_s: 0.0,
    has_floor: true,
};

/// Distance of the walls of a room of 10 m by 6 m from a point 1 m ahead of its middle.
fn wall_m(azimuth_rad: f64) -> f64 {
    let (s, c) = azimuth_rad.sin_cos();
    let x = if c > 0.0 { 4.0 / c } else { -6.0 / c };
    let y = 3.0 / s.abs();
    x.min(y)
}

fn cloud(view: View) -> PointCloud {
    let mut points = Vec::new();
    for ring in 0..32 {
        let slope = (f64::from(ring) - 16.0).to_radians().tan();
        for column in 0..view.columns {
            let part = column as f64 / view.columns as f64;
            let azimuth = view.first_rad + view.sense * TAU * part;
            // A small lean turns the plane of a ring about y.
            let slope = slope - view.lean_deg.to_radians() * azimuth.cos();
            let mut range = wall_m(azimuth);
            if view.has_floor && range * slope < FLOOR_M {
                range = FLOOR_M / slope;
            }
            if range * slope > CEILING_M {
                range = CEILING_M / slope;
            }
            let (s, c) = azimuth.sin_cos();
            let z = range * slope + view.lean_deg.to_radians() * range * c;
            points.push(CloudPoint {
                position_m: [(range * c) as f32, (range * s) as f32, z as f32],
                time_s: (part * view.period_s) as f32,
            });
        }
    }
    PointCloud {
        stamp: STAMP,
        points,
        columns: Some(view.columns),
    }
}

fn band(fields: BandFields) -> PlanarBand {
    PlanarBand::try_from(fields).unwrap()
}

/// Every beam of the scan ends at the wall, within a centimetre.
fn assert_walls(scan: &Scan, returns_min: usize) {
    let shape = scan.shape();
    let mut returns = 0;
    for (beam, &range) in scan.ranges_m().iter().enumerate() {
        let azimuth = shape.angle_min_rad + beam as f64 * shape.angle_increment_rad;
        if range.is_finite() {
            returns += 1;
            let off = (f64::from(range) - wall_m(azimuth)).abs();
            assert!(off < 0.01, "beam {beam} ends {off} m off the wall");
        }
    }
    assert!(
        returns >= returns_min,
        "{returns} of {}",
        scan.ranges_m().len()
    );
}

#[test]
fn floor_and_ceiling_go_and_the_walls_stay() {
    for first_rad in [-PI, -PI + 0.004, 0.3] {
        let view = View { first_rad, ..LEVEL };
        let scan = PlanarBand::default().scan(&cloud(view)).unwrap();
        assert_eq!(scan.ranges_m().len(), 512);
        assert_eq!(scan.shape().time_increment_s.to_bits(), 0.0_f64.to_bits());
        assert_eq!(scan.stamp(), STAMP);
        assert_walls(&scan, 512);
    }
    // The whole height of the room.
    let whole = band(BandFields {
        height_min_m: -2.0,
        height_max_m: 5.0,
        ..BandFields::default()
    });
    assert_walls(&whole.scan(&cloud(LEVEL)).unwrap(), 512);
}

#[test]
fn a_leaning_scanner_does_not_take_the_floor_for_a_wall() {
    for lean_deg in [-3.0, 2.0, 3.0] {
        let view = View { lean_deg, ..LEVEL };
        assert_walls(&PlanarBand::default().scan(&cloud(view)).unwrap(), 500);
    }
    // Without the search for the floor it would.
    let view = View {
        lean_deg: 2.0,
        ..LEVEL
    };
    let careless = band(BandFields {
        clearance_m: 0.0,
        ..BandFields::default()
    });
    let scan = careless.scan(&cloud(view)).unwrap();
    let shape = scan.shape();
    let off = scan.ranges_m().iter().enumerate().filter(|(beam, range)| {
        let azimuth = shape.angle_min_rad + *beam as f64 * shape.angle_increment_rad;
        wall_m(azimuth) - f64::from(**range) > 0.5
    });
    assert!(off.count() > 100);
}

#[test]
fn without_a_floor_no_slice_of_the_walls_is_taken_for_one() {
    let view = View {
        has_floor: false,
        ..LEVEL
    };
    let points = cloud(view).points;
    assert_eq!(HorizontalSurface::find(&points, -1.0), None);
    assert_walls(&PlanarBand::default().scan(&cloud(view)).unwrap(), 512);
}

#[test]
fn the_points_times_make_a_rolling_scan() {
    for (sense, first_rad) in [(1.0, -PI), (-1.0, PI), (1.0, 1.0), (-1.0, -2.0)] {
        let view = View {
            sense,
            first_rad,
            period_s: 0.1,
            ..LEVEL
        };
        let mut cloud = cloud(view);
        // Its stamp is that of its end.
        for point in &mut cloud.points {
            point.time_s -= 0.1;
        }
        let whole = cloud.clone();
        // A few points that cannot be where they are said to be.
        for point in cloud.points.iter_mut().step_by(1001) {
            point.position_m = point.position_m.map(|metres| -metres);
        }
        let scan = PlanarBand::default().scan(&cloud).unwrap();
        let shape = scan.shape();
        assert!((shape.time_increment_s * 512.0 - 0.1).abs() < 1e-4);
        assert!((shape.angle_increment_rad - sense * TAU / 512.0).abs() < 1e-12);
        let off = crate::geometry::wrap_angle_rad(shape.angle_min_rad - first_rad);
        assert!(off.abs() < 1e-4, "{off}");
        assert!((scan.stamp().seconds_since(STAMP) + 0.1).abs() < 1e-6);
        assert_walls(&PlanarBand::default().scan(&whole).unwrap(), 512);
        let ignored = band(BandFields {
            ignore_times: true,
            ..BandFields::default()
        });
        let scan = ignored.scan(&cloud).unwrap();
        assert_eq!(
            (scan.stamp(), scan.shape().time_increment_s.to_bits()),
            (STAMP, 0)
        );
        assert!(!scan.lacks_beam_times(), "nobody asks for them");
    }
    let untimed = PlanarBand::default().scan(&cloud(LEVEL)).unwrap();
    assert!(untimed.lacks_beam_times());
}

#[test]
fn rings_that_look_aside_of_each_other_keep_their_times() {
    let view = View {
        period_s: 0.1,
        ..LEVEL
    };
    let mut cloud = cloud(view);
    // Every other ring looks 3 degrees ahead: its points come earlier.
    let ahead_s = 0.1 * 3.0 / 360.0;
    for (index, point) in cloud.points.iter_mut().enumerate() {
        if index / 512 % 2 == 0 {
            point.time_s = (f64::from(point.time_s) - ahead_s).rem_euclid(0.1) as f32;
        }
    }
    let scan = PlanarBand::default().scan(&cloud).unwrap();
    assert!((scan.shape().time_increment_s * 512.0 - 0.1).abs() < 1e-3);
    assert_walls(&scan, 480);
}

#[test]
fn times_that_tell_of_no_turn_are_refused() {
    let mut cloud = cloud(View {
        period_s: 0.1,
        ..LEVEL
    });
    for (index, point) in cloud.points.iter_mut().enumerate() {
        point.time_s = (index * 7919 % 1000) as f32 * 1e-4;
    }
    let reason = PlanarBand::default().scan(&cloud).unwrap_err().to_string();
    assert!(reason.contains("points: got times that follow") && reason.contains("ignore_times"));
    cloud.points[7].time_s = 3.0;
    let reason = PlanarBand::default().scan(&cloud).unwrap_err().to_string();
    assert!(
        reason.contains("a time 3 s after the stamp, expected within a second"),
        "{reason}"
    );
    cloud.points[7].time_s = f32::NAN;
    assert!(PlanarBand::default().scan(&cloud).is_err());
}

#[test]
fn an_empty_cloud_and_missing_returns_are_normal() {
    let mut cloud = cloud(LEVEL);
    for point in cloud.points.iter_mut().step_by(2) {
        point.position_m[1] = f32::NAN;
    }
    for point in cloud.points.iter_mut().skip(1).step_by(4) {
        point.position_m = [0.0; 3];
    }
    let scan = PlanarBand::default().scan(&cloud).unwrap();
    assert_walls(&scan, 120);
    cloud.points.clear();
    cloud.columns = None;
    let scan = PlanarBand::default().scan(&cloud).unwrap();
    assert_eq!(scan.ranges_m().len(), 1024);
    assert!(scan.ranges_m().iter().all(|range| range.is_infinite()));
}

#[test]
fn a_band_that_cannot_be_is_refused_by_key() {
    let fields = BandFields::default();
    for (fields, key) in [
        (
            BandFields {
                height_min_m: f64::NAN,
                ..fields
            },
            "height_min_m",
        ),
        (
            BandFields {
                height_max_m: -0.6,
                ..fields
            },
            "height_max_m",
        ),
        (
            BandFields {
                range_min_m: -1.0,
                ..fields
            },
            "range_min_m",
        ),
        (
            BandFields {
                range_max_m: 0.2,
                ..fields
            },
            "range_max_m",
        ),
        (
            BandFields {
                clearance_m: 2.0,
                ..fields
            },
            "clearance_m",
        ),
        (
            BandFields {
                beams: Some(8),
                ..fields
            },
            "beams",
        ),
    ] {
        let reason = PlanarBand::try_from(fields).unwrap_err().to_string();
        assert!(
            reason.starts_with(key) && reason.contains("expected"),
            "{reason}"
        );
    }
    let text = serde_json::to_string(&PlanarBand::default()).unwrap();
    assert_eq!(
        serde_json::from_str::<PlanarBand>(&text).unwrap(),
        PlanarBand::default()
    );
    let unknown = serde_json::from_str::<PlanarBand>(r#"{"height_m": 1}"#).unwrap_err();
    assert!(unknown.to_string().contains("height_m"));
}
