//! Sizes of samples.

/// Number of samples of a claim: `few`, which a planted fault does not pass, or `all` in `make campaigns`.
pub fn samples(few: u64, all: u64) -> u64 {
    if std::env::var_os("FLEETCAL_CAMPAIGNS").is_some() {
        all
    } else {
        few
    }
}
