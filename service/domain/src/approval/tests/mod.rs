//! The life cycle as a whole: every state against every event, and long random histories.

mod bench;
mod due;
mod four_eyes;
mod model;
mod retirement;
mod sequences;
mod table;
mod withdrawn;
