//! World that the LiDAR sees: walls, round pillars, and where people may walk.

use super::plane::Point;
use super::ray::{Direction, RayIndex};
use super::shape::{Area, Pillar, Segment};

/// A static world; people walk in it apart from it.
#[derive(Debug, Clone)]
pub struct World {
    segments: Vec<Segment>,
    pillars: Vec<Pillar>,
    walkable: Vec<Area>,
    index: RayIndex,
}

impl World {
    /// Makes a world of walls and pillars. `walkable` are the rectangles people stay in; obstacles
    /// with a coordinate that is not finite are left out.
    pub fn new(segments: Vec<Segment>, pillars: Vec<Pillar>, walkable: Vec<Area>) -> Self {
        let finite = |point: &Point| point.x_m.is_finite() && point.y_m.is_finite();
        let segments: Vec<_> = segments
            .into_iter()
            .filter(|s| finite(&s.from) && finite(&s.to))
            .collect();
        let pillars: Vec<_> = pillars
            .into_iter()
            .filter(|p| finite(&p.centre) && p.radius_m.is_finite())
            .collect();
        let index = RayIndex::new(&segments, &pillars, bounds(&segments, &pillars));
        Self {
            segments,
            pillars,
            walkable,
            index,
        }
    }

    /// Makes a hall of four walls around the origin, viewed from far off: hardly any returns.
    pub fn empty_hall() -> Self {
        let hall = Area::around(Point::default(), 70.0, 50.0);
        let middle = Area::around(Point::default(), 60.0, 40.0);
        Self::new(hall.sides().to_vec(), Vec::new(), vec![middle])
    }

    /// Makes two bare parallel walls along x, 3 m apart and 160 m long: nothing shows the distance
    /// driven.
    pub fn corridor() -> Self {
        let wall = |y_m| Segment {
            from: Point::new(-80.0, y_m),
            to: Point::new(80.0, y_m),
        };
        let floor = Area::around(Point::default(), 150.0, 2.4);
        Self::new(vec![wall(-1.5), wall(1.5)], Vec::new(), vec![floor])
    }

    /// Returns the range from a point in a direction of the world, m; `None` if nothing is nearer
    /// than `range_max_m` or the point lies outside the world.
    pub fn range_m(&self, origin: Point, bearing_rad: f64, range_max_m: f64) -> Option<f64> {
        let direction = Direction::from_angle_rad(bearing_rad);
        let range_m = self.index.range_m(origin, direction, range_max_m);
        range_m.is_finite().then_some(range_m)
    }

    /// Returns its walls.
    pub fn segments(&self) -> &[Segment] {
        &self.segments
    }

    /// Returns its pillars.
    pub fn pillars(&self) -> &[Pillar] {
        &self.pillars
    }

    /// Returns the rectangles people stay in.
    pub fn walkable(&self) -> &[Area] {
        &self.walkable
    }

    pub(super) fn index(&self) -> &RayIndex {
        &self.index
    }
}

fn bounds(segments: &[Segment], pillars: &[Pillar]) -> Area {
    let ends = segments
        .iter()
        .flat_map(|segment| [segment.from, segment.to]);
    let rims = pillars.iter().flat_map(|pillar| {
        let Point { x_m, y_m } = pillar.centre;
        let r = pillar.radius_m;
        [Point::new(x_m - r, y_m - r), Point::new(x_m + r, y_m + r)]
    });
    let start = Area {
        min: Point::default(),
        max: Point::default(),
    };
    ends.chain(rims).fold(start, |area, point| Area {
        min: Point::new(area.min.x_m.min(point.x_m), area.min.y_m.min(point.y_m)),
        max: Point::new(area.max.x_m.max(point.x_m), area.max.y_m.max(point.y_m)),
    })
}
