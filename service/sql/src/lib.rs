//! Records and telemetry in SQL, as each database understands it.
//!
//! What the store asks is written here once, in statements that SQLite and PostgreSQL both take;
//! [`Dialect`] has the few words in which they differ. How a statement reaches a database is a
//! driver's matter: [`Connection`] and [`Pool`].
//!
//! sqlx's own driver for any database takes its options from a URL alone, where SQLite needs its
//! synchronous mode and busy timeout set, and has no values of the type yes or no.

mod accounts;
mod alerts;
mod answers;
mod approvals;
mod audit;
mod certificates;
mod connection;
pub mod copy;
mod dialect;
mod events;
mod history;
mod policy;
mod query;
mod read;
mod records;
mod robots;
mod rollouts;
mod row;
mod statement;
pub mod telemetry;
mod transaction;
mod value;
mod webhooks;

pub use connection::{Connection, Pool, StatementError};
pub use dialect::Dialect;
pub use read::{SqlReader, schema_version};
pub use row::{Keys, key_of};
pub use statement::Statement;
pub use transaction::SqlRecords;
pub use value::{Row, Value};
