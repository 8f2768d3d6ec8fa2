//! Joining checks: wrong inputs of a robot, named from its raw messages and its LiDAR's own motion.
//!
//! The filter is not used: a wrong input often keeps it from starting. Two equations are fitted to
//! the last minute of motion instead. With `u` the LiDAR's velocity in its own frame as a complex
//! number (m/s), `w` its yaw rate (rad/s), and `v` and `d` speed and steering angle as sent:
//!
//! 1. `u = a v + b w`. `|a|` is the unit of the speed, `-arg a` the mount's yaw and `b |a| / (a i)` the
//!    mount's position `x + i y`, all without the steering angle.
//! 2. `w / (|a| v) = c/L tan(g d - d0)`. `g` is the gear or unit of the angle, `c` the wheelbase that
//!    the vehicle was described with over its true one, and the sign of `g c` the product of the signs of
//!    steering, speed and scan.
//!
//! Correlations of `u` with `v` and of `w` with `v tan d` over 8 s show clocks that are apart.
//! Causes that need no motion are found in the messages alone: stamps, frames, ranges.
//!
//! [`Checks`] receives messages one by one in bounded memory, and [`Checks::findings`] returns the
//! wrong inputs, in words. A cause is named only once it showed at every look over 10 m more, or
//! over 5 s where no motion is needed. [`Watch`] repeats them for a robot that goes on sending.

mod cause;
mod checks;
mod curve;
mod finding;
mod fit;
mod grid;
mod inputs;
mod lag;
mod motion;
mod naming;
mod pose_watch;
mod scan_watch;
mod stamps;
mod steering_wrap;
mod stream;
mod watch;

pub use cause::{Cause, Check};
pub use checks::{Checks, Described, Head};
pub use finding::{Finding, State};
pub use inputs::Inputs;
pub use stream::StreamReport;
pub use watch::Watch;
