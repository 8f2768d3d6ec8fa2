//! Certificates of verified calibrations: [`certificate`] makes the document from the records of a
//! verification, [`page`] and [`text`] show it to people.
//!
//! Pure: no clock, no database, no wire. Page and text are made from the signed document alone, so
//! that they show nothing beyond its signature.

mod facts;
mod made;
mod shown;

pub use made::{Verified, certificate};
pub use shown::{page, text};
