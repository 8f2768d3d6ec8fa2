//! A robot's agent: pulls the approved calibration for the robot, checks it, brings it into use,
//! acknowledges it, and goes back by itself when nobody confirms.
//!
//! [`Agent`] decides: it takes [`Event`]s and says which [`Effect`]s follow, and knows neither clock
//! nor wire nor disk. [`run_agent`] is the agent of a real robot, whose values are a file; a
//! simulated robot puts the same decisions into effect on its simulation.

mod event;
mod file;
mod hook;
mod in_place;
mod keys;
mod limits;
mod link;
mod machine;
mod offer;
mod options;
mod outputs;
mod question;
mod run;
mod state;
#[cfg(test)]
mod tests;

pub use event::{Activation, Effect, Event, HookAnswer, TransitionRefused};
pub use file::FileError;
pub use hook::{EXIT_BUSY, Hook};
pub use keys::KeyRing;
pub use limits::{Limits, OutsideLimits, Range, RangeRefused};
pub(crate) use link::CalibrationLink;
pub use machine::Agent;
pub use offer::{CONFIRM_WITHIN_MAX_S, Identity};
pub use options::{AgentError, AgentOptions};
pub use outputs::{OutputKind, Outputs, VehicleFrames};
pub use run::run_agent;
pub(crate) use run::{PULL_PERIOD, follow};
pub use state::{Ending, Fallback, Held, Memory, MemorySchema, Offer, Outcome, Phase, Rest, Trial};
