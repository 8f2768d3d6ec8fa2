//! PostgreSQL beside SQLite.
