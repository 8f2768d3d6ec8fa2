//! Fit of a scan to the map, counted point by point.

/// Least share explained by a good fit; below it a better pose is searched for, and the state is
/// degraded.
const EXPLAINED_GOOD: f32 = 0.6;
/// Least share of all points, moving or not, on the map.
const ON_MAP_MIN: f32 = 0.12;
/// Least share of the points that a known map must cover to be used.
const KNOWN_MIN: f32 = 0.2;
/// Least share of the covered points that agree with a known map where a pose is found: people
/// stand before walls.
pub const AGREEMENT_FOUND: f32 = 0.45;
/// Weight of a point where nothing is known, when a pose is sought in a known map.
const SILENT_WEIGHT: f32 = 0.3;

/// Fit of a scan's points to the map at one pose.
#[derive(Debug, Clone, Copy, Default)]
pub struct Fit {
    /// Assessed points.
    pub points: f32,
    /// Points on the map, within its noise.
    pub on_map: f32,
    /// Points where space was seen free before: people, other robots.
    pub moving: f32,
    /// Sum over the points of their closeness to the map, 1 for a point on its line.
    pub score: f32,
    /// Part of `score` that belongs to the moving points.
    pub score_of_moving: f32,
    /// Points on the surfaces of a map known before.
    pub agrees: f32,
    /// Points where that map has nothing, or a surface elsewhere.
    pub disagrees: f32,
}

impl Fit {
    /// Share of the points that lie on the map.
    pub fn fitness(&self) -> f64 {
        if self.points > 0.0 {
            f64::from(self.on_map / self.points)
        } else {
            0.0
        }
    }

    /// Share of the points that do not move that lie on the map.
    pub fn explained(&self) -> f32 {
        if self.on_map < ON_MAP_MIN * self.points {
            return 0.0;
        }
        self.on_map / (self.points - self.moving).max(1.0)
    }

    /// Mean closeness of the points that do not move to the map, 0 to 1.
    pub fn closeness(&self) -> f32 {
        (self.score - self.score_of_moving) / (self.points - self.moving).max(1.0)
    }

    /// Share of the points that agree with a known map; `None` where it covers too few.
    pub fn agreement(&self) -> Option<f32> {
        let said = self.agrees + self.disagrees;
        (said > KNOWN_MIN * self.points).then(|| self.agrees / said)
    }

    /// True if it fits a known map so well that this is the place. Points where nothing is known
    /// count a little against it, or a view away from the map would fit anywhere.
    pub fn places(&self) -> bool {
        let said = self.agrees + self.disagrees;
        let silent = self.points - said;
        self.agrees >= AGREEMENT_FOUND * (said + SILENT_WEIGHT * silent)
    }

    /// True if enough of the still points lie on the map.
    pub fn is_good(&self) -> bool {
        self.explained() >= EXPLAINED_GOOD
    }

    /// True if this fit is clearly better than another.
    pub fn beats(&self, other: &Self) -> bool {
        self.score > 1.03 * other.score
    }
}
