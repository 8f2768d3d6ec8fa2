//! Values drawn at random, the awkward ones among them.

use fleetcal_contract::NOW_S;
use fleetcal_model::WallTime;
use fleetcal_proto::RobotId;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// Robots whose ids a collation orders differently from bytes.
const ROBOTS: [&str; 6] = ["a", "B", "a-b", "a_c", "Ab", "a2"];

/// Draws one of several.
pub fn pick<T: Copy>(chance: &mut ChaCha8Rng, among: &[T]) -> T {
    among[chance.random_range(0..among.len())]
}

/// Draws a robot.
pub fn robot(chance: &mut ChaCha8Rng) -> RobotId {
    fleetcal_contract::robot(pick(chance, &ROBOTS))
}

/// Returns all robots.
pub fn robots() -> impl Iterator<Item = RobotId> {
    ROBOTS.into_iter().map(fleetcal_contract::robot)
}

/// Draws an integer, sometimes an extreme one.
pub fn number(chance: &mut ChaCha8Rng) -> i64 {
    match chance.random_range(0..10) {
        0 => i64::MAX,
        1 => 0,
        2 => -1,
        _ => chance.random_range(0..2_000_000_000_000_000_000),
    }
}

/// Draws a real number, sometimes an extreme one.
pub fn real(chance: &mut ChaCha8Rng) -> f64 {
    match chance.random_range(0..12) {
        0 => 0.1 + 0.2,
        1 => -0.0,
        2 => 5e-324,
        3 => 1.797e308,
        4 => 1e21,
        _ => chance.random_range(-1.0..1.0),
    }
}

/// Draws words in several scripts, with characters that SQL and JSON quote.
pub fn words(chance: &mut ChaCha8Rng) -> String {
    const WORDS: [&str; 12] = [
        "",
        " ",
        "it's",
        "\"quoted\"",
        "back\\slash",
        "line\nbreak",
        "ß",
        "日本",
        "🤖",
        "%",
        "_",
        "$1 -- ;",
    ];
    let count = chance.random_range(0..4);
    (0..count).map(|_| pick(chance, &WORDS)).collect()
}

/// Draws a time in the minutes around the clock's.
pub fn time(chance: &mut ChaCha8Rng) -> WallTime {
    WallTime((NOW_S + chance.random_range(0..600)) * 1_000_000_000 + chance.random_range(0..9))
}
