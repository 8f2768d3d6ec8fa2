//! Kinds of hostile sessions, as their process is told and tests ask for.

/// Each kind, in the order in which sessions take them when all is done at once.
pub const KINDS: [&str; 8] = [
    "tokens",
    "subscribers",
    "queryables",
    "queries",
    "liveliness_queries",
    "liveliness_subscribers",
    "notes",
    "answers",
];
