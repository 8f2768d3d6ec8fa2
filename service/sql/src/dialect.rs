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

    /// The elements of the list `robots` of an alert's record, as rows with a column `value`.
    pub(crate) const fn robots_of_alert(self) -> &'static str {
        match self {
            Self::Sqlite => "json_each(record, '$.robots')",
            Self::Postgres => "json_array_elements_text(record::json -> 'robots') AS named (value)",
        }
    }

    /// The elements of `$1`, a list of texts as JSON, as rows with a column `value`.
    pub(crate) const fn elements(self) -> &'static str {
        match self {
            Self::Sqlite => "json_each($1)",
            Self::Postgres => "json_array_elements_text($1::json) AS named (value)",
        }
    }
}
