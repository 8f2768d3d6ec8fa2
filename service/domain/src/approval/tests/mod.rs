//! The life cycle as a whole: every state against every event, and long random histories.

mod due;
mod model;
mod sequences;
mod table;
