//! Reasons for which an estimator leaves out a message that could be read.

/// Reason for which a message is left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LeftOutReason {
    /// Older than what was already processed.
    Late,
    /// The same stamp of the same stream again.
    Duplicate,
    /// A scan without enough returns, or while LiDAR odometry is lost.
    Unusable,
    /// A speed without an angle near it.
    Unpaired,
}

impl LeftOutReason {
    /// Number of reasons.
    pub const COUNT: usize = 4;
    /// Every reason.
    pub const ALL: [Self; Self::COUNT] =
        [Self::Late, Self::Duplicate, Self::Unusable, Self::Unpaired];

    /// The name in documents and in `/metrics`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Late => "late",
            Self::Duplicate => "duplicate",
            Self::Unusable => "unusable",
            Self::Unpaired => "unpaired",
        }
    }
}
