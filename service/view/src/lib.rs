//! Views of the fleet: which robots a list has, and in which order.
//!
//! A [`Query`] such as `model:tricycle site:hamburg deviation>1` selects robots by their
//! [`Properties`]; a [`Sort`] such as `-deviation` orders them. Both are text that the API, the
//! dashboard's addresses and people share, and print as they are parsed.
//!
//! Pure: the clock is an argument; no I/O.

mod folded;
mod parse;
mod properties;
mod query;
mod sort;
mod table;
mod word;

pub use folded::Folded;
pub use parse::QueryRefused;
pub use properties::Properties;
pub use query::{Comparison, Condition, Measure, Query, Term, TimeUnit};
pub use sort::{Position, PositionRefused, Sort, SortKey, SortRefused};
pub use table::{COLUMNS, fields};
pub use word::Word;
