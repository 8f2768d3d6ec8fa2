//! Checks of simulated imperfections.

use std::f64::consts::PI;

use super::{
    ClockImperfections, Imperfections, LidarImperfections, ScannerImperfections,
    VehicleImperfections,
};
use crate::simulator::check::{SettingRefused, check};
use crate::simulator::config::LidarOutput;
use crate::simulator::steering_curve::SteeringCurve;
use crate::simulator::vehicle::VehicleTruth;

/// Flattest steering curve: below this the shown angle hardly determines the wheel's.
const LEAST_SLOPE: f64 = 0.05;

impl Imperfections {
    /// Checks every number, for the vehicle and the LiDAR that have them.
    ///
    /// # Errors
    /// Names the first value that cannot be simulated.
    pub fn check(
        &self,
        vehicle: &VehicleTruth,
        output: &LidarOutput,
    ) -> Result<(), SettingRefused> {
        self.vehicle.check_steering(vehicle)?;
        self.vehicle.check_wheels()?;
        self.lidar.check()?;
        self.scanner.check()?;
        self.clocks.check()?;
        if matches!(output, LidarOutput::Poses(_)) {
            self.scanner.check_absent()?;
        }
        Ok(())
    }
}

impl VehicleImperfections {
    fn check_steering(&self, vehicle: &VehicleTruth) -> Result<(), SettingRefused> {
        let share = -0.3..=0.3;
        let angle = -0.2..=0.2;
        let (gain, asymmetry) = (self.steering_gain, self.steering_asymmetry);
        let (quadratic, cubic) = (self.steering_quadratic_rad, self.steering_cubic_rad);
        check([
            (
                "imperfections.vehicle.steering_gain",
                gain,
                share.clone(),
                "-0.3 to 0.3",
            ),
            (
                "imperfections.vehicle.steering_asymmetry",
                asymmetry,
                share,
                "-0.3 to 0.3",
            ),
            (
                "imperfections.vehicle.steering_quadratic_rad",
                quadratic,
                angle.clone(),
                "-0.2 to 0.2 rad",
            ),
            (
                "imperfections.vehicle.steering_cubic_rad",
                cubic,
                angle,
                "-0.2 to 0.2 rad",
            ),
            (
                "imperfections.vehicle.backlash_rad",
                self.backlash_rad,
                0.0..=0.2,
                "0 to 0.2 rad",
            ),
            (
                "imperfections.vehicle.steering_lag_s",
                self.steering_lag_s,
                0.0..=1.0,
                "0 to 1 s",
            ),
            (
                "imperfections.vehicle.steering_delay_s",
                self.steering_delay_s,
                0.0..=1.0,
                "0 to 1 s",
            ),
            (
                "imperfections.vehicle.undithered_step_rad",
                self.undithered_step_rad,
                0.0..=0.2,
                "0 to 0.2 rad",
            ),
            (
                "slope of the steering curve",
                SteeringCurve::new(vehicle.steering_gain, self).least_slope(),
                LEAST_SLOPE..=f64::INFINITY,
                "0.05 or more up to 45°",
            ),
        ])
    }

    fn check_wheels(&self) -> Result<(), SettingRefused> {
        check([
            (
                "imperfections.vehicle.wheelbase",
                self.wheelbase,
                -0.3..=0.3,
                "-0.3 to 0.3",
            ),
            (
                "imperfections.vehicle.wheel_sizes",
                self.wheel_sizes,
                -0.2..=0.2,
                "-0.2 to 0.2",
            ),
            (
                "imperfections.vehicle.speed_encoder_y_m",
                self.speed_encoder_y_m,
                -2.0..=2.0,
                "-2 to 2 m",
            ),
            (
                "imperfections.vehicle.side_slip_rad_per_mps2",
                self.side_slip_rad_per_mps2,
                -0.2..=0.2,
                "-0.2 to 0.2 rad s²/m",
            ),
            // An oversteering vehicle would leave its path above its critical speed.
            (
                "imperfections.vehicle.understeer_rad_per_mps2",
                self.understeer_rad_per_mps2,
                -0.02..=0.2,
                "-0.02 to 0.2 rad s²/m",
            ),
        ])
    }
}

impl LidarImperfections {
    fn check(&self) -> Result<(), SettingRefused> {
        check([
            (
                "imperfections.lidar.scan_rate_hz",
                self.scan_rate_hz.unwrap_or(1.0),
                0.5..=100.0,
                "0.5 to 100 Hz",
            ),
            (
                "imperfections.lidar.range_scale",
                self.range_scale,
                -0.1..=0.1,
                "-0.1 to 0.1",
            ),
        ])
    }
}

impl ScannerImperfections {
    fn check(&self) -> Result<(), SettingRefused> {
        check([
            (
                "imperfections.scanner.range_bias_m",
                self.range_bias_m,
                -0.5..=0.5,
                "-0.5 to 0.5 m",
            ),
            (
                "imperfections.scanner.incidence_bias_m",
                self.incidence_bias_m,
                -0.5..=0.5,
                "-0.5 to 0.5 m",
            ),
            (
                "imperfections.scanner.mixed_pixels",
                self.mixed_pixels,
                0.0..=1.0,
                "0 to 1",
            ),
            (
                "imperfections.scanner.tilt_rad",
                self.tilt_rad,
                0.0..=0.2,
                "0 to 0.2 rad",
            ),
            (
                "imperfections.scanner.tilt_direction_rad",
                self.tilt_direction_rad,
                -2.0 * PI..=2.0 * PI,
                "-2 pi to 2 pi rad",
            ),
        ])
    }

    /// Checks that a robot which sends poses has no imperfect beams.
    fn check_absent(&self) -> Result<(), SettingRefused> {
        let flag = |set: bool| f64::from(u8::from(set));
        for (field, value) in [
            ("imperfections.scanner.range_bias_m", self.range_bias_m),
            (
                "imperfections.scanner.incidence_bias_m",
                self.incidence_bias_m,
            ),
            (
                "imperfections.scanner.untimed_beams",
                flag(self.untimed_beams),
            ),
            (
                "imperfections.scanner.stamped_at_end",
                flag(self.stamped_at_end),
            ),
            ("imperfections.scanner.mixed_pixels", self.mixed_pixels),
            ("imperfections.scanner.tilt_rad", self.tilt_rad),
        ] {
            let accepted = "0 on a robot that sends poses, which have no beams";
            check([(field, value, 0.0..=0.0, accepted)])?;
        }
        Ok(())
    }
}

impl ClockImperfections {
    fn check(&self) -> Result<(), SettingRefused> {
        check([
            (
                "imperfections.clocks.drive_drift",
                self.drive_drift,
                -0.01..=0.01,
                "-0.01 to 0.01",
            ),
            (
                "imperfections.clocks.stamp_jitter_s",
                self.stamp_jitter_s,
                0.0..=0.2,
                "0 to 0.2 s",
            ),
            (
                "imperfections.clocks.lost_messages",
                self.lost_messages,
                0.0..=0.9,
                "0 to 0.9",
            ),
        ])
    }
}
