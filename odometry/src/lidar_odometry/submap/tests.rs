use super::tiles::TILES_MAX;
use super::*;

/// A wall along y at `x_m`, seen a few times.
fn wall_at(submap: &mut Submap, x_m: f64, y_m: f64) -> LocalOrigin {
    let origin = LocalOrigin::near(x_m, y_m);
    let (ox, oy) = origin.position_m();
    let (x, y) = ((x_m - ox) as f32, (y_m - oy) as f32);
    for update in 0..4 {
        submap.begin_update(origin.locate(x, y).0, 0.015);
        for i in 0..60 {
            submap.insert(origin, (x, y + 0.01 * i as f32), (1.0, 0.0), 1.0);
            submap.insert(
                origin,
                (x, y + 0.01 * i as f32 + 0.002 * update as f32),
                (1.0, 0.0),
                1.0,
            );
        }
        submap.end_update();
    }
    origin
}

#[test]
fn a_wall_is_where_it_is_a_thousand_kilometres_from_the_start_too() {
    for x_m in [0.0437, -12.3437, 1.0e6 + 0.0437] {
        let mut submap = Submap::default();
        let origin = wall_at(&mut submap, x_m, -3.0);
        let (ox, oy) = origin.position_m();
        // A point 3 cm to the right of the wall.
        let (cell, cx, cy) = origin.locate((x_m + 0.03 - ox) as f32, (-2.7 - oy) as f32);
        let line = submap.line(cell);
        assert!(line.exists());
        let distance = (line.nx * cx + line.ny * cy - line.d).abs();
        assert!((distance - 0.03).abs() < 1e-4, "{distance} at {x_m}");
    }
}

#[test]
fn the_pool_of_tiles_is_bounded_and_the_latest_stay() {
    let mut submap = Submap::default();
    for i in 0..1500 {
        wall_at(
            &mut submap,
            1.7 * f64::from(i % 100),
            1.7 * f64::from(i / 100),
        );
    }
    assert!(submap.tiles.len() <= TILES_MAX);
    assert!(submap.memory_bytes() < 7 << 19, "{}", submap.memory_bytes());
    let origin = LocalOrigin::near(1.7 * 99.0, 1.7 * 14.0);
    let (ox, oy) = origin.position_m();
    let (cell, _, _) = origin.locate((1.7 * 99.0 - ox) as f32, (1.7 * 14.0 + 0.3 - oy) as f32);
    assert!(submap.line(cell).exists());
}

#[test]
fn tiles_far_behind_are_dropped() {
    let mut submap = Submap::default();
    let origin = wall_at(&mut submap, 0.0, 0.0);
    wall_at(&mut submap, 60.0, 0.0);
    assert!(submap.line(origin.locate(0.01, 0.3).0).exists());
    wall_at(&mut submap, 120.0, 0.0);
    assert!(!submap.line(origin.locate(0.01, 0.3).0).exists());
}

#[test]
fn a_line_beside_a_corner_lies_on_its_wall() {
    let mut submap = Submap::default();
    let origin = LocalOrigin::near(1.0, 1.0);
    for _ in 0..4 {
        submap.begin_update(origin.locate(0.5, 0.5).0, 0.01);
        for i in 0..80 {
            let (along, noise) = (0.01 * i as f32, if i % 2 == 0 { 0.01 } else { -0.01 });
            // A box's front up to its corner at (0.55, 0.82), and its side, seen at a flat angle.
            submap.insert(origin, (0.55 + noise, 0.82 - along), (1.0, 0.0), 1.0);
            if i % 8 == 0 {
                submap.insert(origin, (0.55 + along, 0.82), (1.0, 0.0), 1.0);
            }
        }
        submap.end_update();
    }
    for y in [0.55, 0.65, 0.75] {
        let (cell, cx, cy) = origin.locate(0.55, y);
        let line = submap.line(cell);
        assert!(line.exists(), "no line at {y}");
        let distance_m = (line.nx * cx + line.ny * cy - line.d).abs();
        assert!(distance_m < 1e-3, "{distance_m} m at {y}");
    }
}
