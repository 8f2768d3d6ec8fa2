//! Several instances on one database: who estimates which robot, and what nobody writes who does
//! not.

mod adoption;
mod epochs;
mod fence;
mod instance;
mod moves;
mod names;
mod tenure;
mod tries;
