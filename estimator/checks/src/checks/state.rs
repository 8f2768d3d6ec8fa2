//! State of a check that names no cause.

use fleetcal_model::Stream;

use super::Checks;
use crate::cause::Check;
use crate::finding::{Finding, State};
use crate::motion::Motion;

impl Checks {
    /// The entry of a check that names no cause.
    pub(super) fn unnamed(&self, check: Check) -> Option<Finding> {
        let (state, seen) = self.state_of(check)?;
        Some(Finding {
            check,
            state,
            cause: None,
            seen,
            after_m: 0.0,
            after_s: 0.0,
        })
    }

    fn state_of(&self, check: Check) -> Option<(State, String)> {
        let ok = |seen: String| Some((State::Ok, seen));
        let not_yet = |what: &str| Some((State::NotYet, what.to_owned()));
        let motion = self.motion.as_ref();
        let mount = motion.and_then(|of| of.mount);
        let steering = motion
            .and_then(|of| of.steering.as_ref())
            .filter(|of| of.explained > 0.6);
        match check {
            Check::Streams if self.lidar().is_some() && self.wheels().is_some() => {
                ok(String::new())
            }
            Check::Streams => not_yet("waits for wheel odometry and scans"),
            Check::Stamps if self.aligned_s.is_some() => ok(String::new()),
            Check::Stamps => not_yet("waits for 3 s of both streams"),
            Check::Scan if self.of(&[Stream::Scan]).is_none() => None,
            Check::Scan if self.scans.is_judged() => ok(format!(
                "{:.0} % of the beams have a return",
                100.0 * self.scans.returns()
            )),
            Check::Scan => not_yet("waits for 40 scans"),
            Check::Pose if self.of(&[Stream::LidarOdometry]).is_none() => None,
            Check::Pose if self.poses.is_judged() => ok(String::new()),
            Check::Pose => not_yet("drive 5 m"),
            Check::Clocks => {
                match motion.filter(|of| of.by_speed.sigma_s.min(of.by_steering.sigma_s) < 0.2) {
                    Some(of) => ok(format!("{:+.0} ms by the motion", -1e3 * of.used_lag_s)),
                    None => not_yet("drive at changing speed"),
                }
            }
            Check::Speed => match mount {
                Some(of) => ok(format!("{:.3} m for each reported metre", of.scale)),
                None => not_yet("drive 10 m"),
            },
            Check::Steering => match steering {
                Some(of) => ok(format!(
                    "turns {:.3} times as much as the angle says",
                    of.turns()
                )),
                None => not_yet("drive turns"),
            },
            Check::Wheelbase => match steering {
                Some(of) if of.both_sides => ok(String::new()),
                _ => not_yet("turn to the left and to the right"),
            },
            Check::Model => match motion.and_then(Motion::is_at_steered_wheel) {
                Some(true) => ok("speed of the steered wheel".to_owned()),
                Some(false) => ok("speed of the fixed axle".to_owned()),
                None => not_yet("drive narrow turns"),
            },
            Check::Delay => {
                match motion.filter(|of| of.by_speed.sigma_s.hypot(of.by_steering.sigma_s) < 0.06) {
                    Some(_) => ok(String::new()),
                    None => not_yet("drive turns at changing speed"),
                }
            }
            Check::Vehicle => match mount {
                Some(of) => ok(format!(
                    "mount about x {:.2} m, y {:.2} m, yaw {:.1} degrees, without the steering",
                    of.x_m,
                    of.y_m,
                    of.yaw_rad.to_degrees()
                )),
                None => not_yet("drive 10 m"),
            },
        }
    }
}
