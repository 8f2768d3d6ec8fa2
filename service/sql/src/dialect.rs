//! The few words in which the databases differ.

/// What a database speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dialect {
    /// SQLite.
    Sqlite,
    /// PostgreSQL.
    Postgres,
}

impl Dialect {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Sqlite, Self::Postgres];

    /// The function that gives the lower of two values.
    pub(crate) const fn lower_of_two(self) -> &'static str {
        match self {
            Self::Sqlite => "min",
            Self::Postgres => "least",
        }
    }

    /// The function that gives the higher of two values.
    pub(crate) const fn higher_of_two(self) -> &'static str {
        match self {
            Self::Sqlite => "max",
            Self::Postgres => "greatest",
        }
    }

    /// The elements of the list `robots` of an alert's record, as rows with a column `value`.
    pub(crate) const fn robots_of_alert(self) -> &'static str {
        match self {
            Self::Sqlite => "json_each(record, '$.robots')",
            Self::Postgres => "json_array_elements_text(record::json -> 'robots') AS named (value)",
        }
    }

    /// Whether one statement may merge several rows into the same one.
    pub(crate) const fn merges_many(self) -> bool {
        matches!(self, Self::Sqlite)
    }
}
