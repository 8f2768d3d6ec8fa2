//! The few words in which the databases differ.

/// Dialect of SQL of a database.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dialect {
    /// SQLite.
    Sqlite,
    /// PostgreSQL.
    Postgres,
}

impl Dialect {
    /// Both dialects.
    pub const ALL: [Self; 2] = [Self::Sqlite, Self::Postgres];

    /// Returns the source of the elements of the list `robots` in an alert's record, as rows with a
    /// column `value`.
    pub(crate) const fn robots_of_alert(self) -> &'static str {
        match self {
            Self::Sqlite => "json_each(record, '$.robots')",
            Self::Postgres => "json_array_elements_text(record::json -> 'robots') AS named (value)",
        }
    }

    /// Returns the source of the elements of `$1`, a list of texts as JSON, as rows with a column
    /// `value`.
    pub(crate) const fn elements(self) -> &'static str {
        match self {
            Self::Sqlite => "json_each($1)",
            Self::Postgres => "json_array_elements_text($1::json) AS named (value)",
        }
    }
}
