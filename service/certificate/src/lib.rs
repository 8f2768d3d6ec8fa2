//! Certificates of verified calibrations: [`certificate`] makes the document from the records of a
//! verification, [`page`] and [`text`] show it to people.
//!
//! Pure: no clock, no database, no wire. What people read is made from the signed document alone,
//! so that a page says what its signature covers.

mod facts;
mod made;
mod shown;

pub use made::{Verified, certificate};
pub use shown::{page, text};
