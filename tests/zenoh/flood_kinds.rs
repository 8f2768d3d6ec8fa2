//! What hostile sessions do: said to their process, and asked for by the tests.

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
