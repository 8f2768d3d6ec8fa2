//! A warehouse with racks, pallets, pillars and a free staging area.

use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::plane::{Point, Pose2};
use super::random::{Stream, stream};
use super::shape::{Area, Pillar, Segment};
use super::world::World;

/// Middles of the rack rows along y, m. The aisles between them are 2.9 m wide.
const RACK_ROWS_Y_M: [f64; 5] = [-8.0, -4.0, 0.0, 4.0, 8.0];
/// First and last x of the two rack blocks; the cross aisle lies between them.
const RACK_BLOCKS_X_M: [(f64, f64); 2] = [(0.0, 8.1), (10.7, 16.1)];
/// Width of a rack's bay along x, m.
const BAY_M: f64 = 2.7;
/// Depth of a rack along y, m.
const RACK_DEPTH_M: f64 = 1.1;

impl World {
    /// Makes a hall of 40 m by 24 m around the origin: a free staging area for x below -3 m, five
    /// rows of racks with aisles along y = -6, -2, 2 and 6 m beside it, a cross aisle at x = 9.4 m.
    /// The seed moves pallets, pillars and clutter; routes stay free.
    pub fn warehouse(seed: u64) -> Self {
        let mut random = stream(seed, Stream::World);
        let mut segments = Area::around(Point::default(), 40.0, 24.0).sides().to_vec();
        add_pilasters(&mut segments, &mut random);
        for y_m in RACK_ROWS_Y_M {
            for (from_m, to_m) in RACK_BLOCKS_X_M {
                add_rack(&mut segments, &mut random, y_m, from_m, to_m);
            }
        }
        add_clutter(&mut segments, &mut random);
        let pillars = pillars(&mut random);
        let aisle = |y_m: f64| Area::around(Point::new(8.0, y_m), 19.0, 2.2);
        let walkable = vec![
            Area::around(Point::new(-11.0, 0.0), 14.0, 18.0),
            aisle(-6.0),
            aisle(-2.0),
            aisle(2.0),
            aisle(6.0),
            Area::around(Point::new(9.4, 0.0), 1.6, 18.0),
        ];
        Self::new(segments, pillars, walkable)
    }
}

/// Adds a box of `length_m` by `width_m` that may stand askew.
fn add_box(segments: &mut Vec<Segment>, pose: Pose2, length_m: f64, width_m: f64) {
    let place = |point: Point| {
        let in_world = pose.compose(&Pose2::new(point.x_m, point.y_m, 0.0));
        in_world.point()
    };
    let sides = Area::around(Point::default(), length_m, width_m).sides();
    segments.extend(sides.map(|side| Segment {
        from: place(side.from),
        to: place(side.to),
    }));
}

/// Adds wall pilasters and door frames: without them a long wall carries no information along
/// itself.
fn add_pilasters(segments: &mut Vec<Segment>, random: &mut ChaCha8Rng) {
    for side in [-1.0, 1.0] {
        let mut x_m = -18.0;
        while x_m < 19.0 {
            add_box(segments, Pose2::new(x_m, side * 11.85, 0.0), 0.4, 0.3);
            x_m += random.random_range(3.0..5.5);
        }
        let mut y_m = -10.0;
        while y_m < 11.0 {
            add_box(segments, Pose2::new(side * 19.85, y_m, 0.0), 0.3, 0.5);
            y_m += random.random_range(2.5..4.5);
        }
    }
}

/// Adds one row: uprights at each bay's end, two places for pallets between them, some of them
/// empty.
fn add_rack(
    segments: &mut Vec<Segment>,
    random: &mut ChaCha8Rng,
    y_m: f64,
    from_m: f64,
    to_m: f64,
) {
    let bays = ((to_m - from_m) / BAY_M).round() as usize;
    for upright in 0..=bays {
        for side in [-0.5, 0.5] {
            let x_m = from_m + upright as f64 * BAY_M;
            add_box(
                segments,
                Pose2::new(x_m, y_m + side * RACK_DEPTH_M, 0.0),
                0.1,
                0.08,
            );
        }
    }
    for place in 0..2 * bays {
        if random.random_bool(0.15) {
            continue;
        }
        let x_m = from_m + (place as f64 + 0.5) * 0.5 * BAY_M + random.random_range(-0.06..0.06);
        let pose = Pose2::new(
            x_m,
            y_m + random.random_range(-0.08..0.08),
            random.random_range(-0.03..0.03),
        );
        let length_m = random.random_range(0.8..1.15);
        add_box(segments, pose, length_m, random.random_range(0.8..1.0));
    }
}

/// Adds pallets and machines along the staging area's walls.
fn add_clutter(segments: &mut Vec<Segment>, random: &mut ChaCha8Rng) {
    for side in [-1.0, 1.0] {
        for place in 0..4 {
            let pose = Pose2::new(
                -16.5 + 3.6 * f64::from(place) + random.random_range(-0.8..0.8),
                side * random.random_range(10.3..10.9),
                random.random_range(-0.3..0.3),
            );
            let length_m = random.random_range(0.8..1.4);
            add_box(segments, pose, length_m, random.random_range(0.6..1.0));
        }
    }
}

fn pillars(random: &mut ChaCha8Rng) -> Vec<Pillar> {
    let mut pillars = Vec::new();
    for x_m in [-18.6, -3.4, 18.9] {
        for y_m in [-9.5, -4.0, 0.0, 4.0, 9.5] {
            // One of the staging area's inner pillars would stand in the way of its routes.
            if x_m < -3.0 && y_m == 0.0 {
                continue;
            }
            let centre = Point::new(x_m + random.random_range(-0.1..0.1), y_m);
            pillars.push(Pillar {
                centre,
                radius_m: random.random_range(0.18..0.3),
            });
        }
    }
    pillars
}
