//! One independent stream of random numbers for each part of the simulation, so that a setting of
//! one part leaves the others' numbers as they were.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Part of the simulation that draws random numbers.
#[derive(Debug, Clone, Copy)]
#[repr(u64)]
pub(super) enum Stream {
    World = 1,
    People,
    WheelOdometry,
    Lidar,
    Pose,
    Slip,
    Localisation,
    Imperfections,
    Jitter,
    Losses,
    MixedPixels,
    WrongInputs,
}

/// Makes the generator of one part.
pub(super) fn stream(seed: u64, stream: Stream) -> ChaCha8Rng {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    generator.set_stream(stream as u64);
    generator
}
