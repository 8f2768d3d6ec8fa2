//! Kinds of hostile sessions, as their process is told and tests ask for.

/// All kinds, in the order in which sessions use them when all run at once.
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
