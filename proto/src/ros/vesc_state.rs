//! `vesc_msgs/msg/VescStateStamped`: state of a VESC motor controller, as of `f1tenth`.

use serde::{Deserialize, Serialize};

use super::wheels::{Joints, Unstated, WheelMessage, Wheels};
use super::{Header, RosMessage};
use crate::cdr::{CdrError, CdrReader, CdrWriter};

/// Telemetry of the controller.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VescState {
    /// Temperature of the transistors, °C.
    pub temp_fet: f64,
    /// Temperature of the motor, °C.
    pub temp_motor: f64,
    /// Current of the motor, A.
    pub current_motor: f64,
    /// Current of the battery, A.
    pub current_input: f64,
    /// Direct current, A.
    pub avg_id: f64,
    /// Quadrature current, A.
    pub avg_iq: f64,
    /// Duty cycle, 0 to 1.
    pub duty_cycle: f64,
    /// Electrical speed of the motor, revolutions per minute.
    pub speed: f64,
    /// Voltage of the battery, V.
    pub voltage_input: f64,
    /// Charge drawn, Ah.
    pub charge_drawn: f64,
    /// Charge regenerated, Ah.
    pub charge_regen: f64,
    /// Energy drawn, Wh.
    pub energy_drawn: f64,
    /// Energy regenerated, Wh.
    pub energy_regen: f64,
    /// Net tachometer, counts.
    pub displacement: i32,
    /// Total tachometer, counts.
    pub distance_traveled: i32,
    /// Fault, 0 for none.
    pub fault_code: i32,
    /// Position by the controller, degrees.
    pub pid_pos_now: f64,
    /// Number of the controller.
    pub controller_id: i32,
    /// Temperature of the first transistor, °C.
    pub ntc_temp_mos1: f64,
    /// Temperature of the second transistor, °C.
    pub ntc_temp_mos2: f64,
    /// Temperature of the third transistor, °C.
    pub ntc_temp_mos3: f64,
    /// Direct voltage, V.
    pub avg_vd: f64,
    /// Quadrature voltage, V.
    pub avg_vq: f64,
}

/// Telemetry with its stamp.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VescStateStamped {
    /// Stamp of its reception by the driver.
    pub header: Header,
    /// The telemetry.
    pub state: VescState,
}

impl RosMessage for VescStateStamped {
    const TYPE: &'static str = "vesc_msgs/msg/VescStateStamped";

    fn read(mut reader: CdrReader<'_>) -> Result<Self, CdrError> {
        let header = Header::read(&mut reader)?;
        let state = VescState {
            temp_fet: reader.f64("state.temp_fet")?,
            temp_motor: reader.f64("state.temp_motor")?,
            current_motor: reader.f64("state.current_motor")?,
            current_input: reader.f64("state.current_input")?,
            avg_id: reader.f64("state.avg_id")?,
            avg_iq: reader.f64("state.avg_iq")?,
            duty_cycle: reader.f64("state.duty_cycle")?,
            speed: reader.f64("state.speed")?,
            voltage_input: reader.f64("state.voltage_input")?,
            charge_drawn: reader.f64("state.charge_drawn")?,
            charge_regen: reader.f64("state.charge_regen")?,
            energy_drawn: reader.f64("state.energy_drawn")?,
            energy_regen: reader.f64("state.energy_regen")?,
            displacement: reader.i32("state.displacement")?,
            distance_traveled: reader.i32("state.distance_traveled")?,
            fault_code: reader.i32("state.fault_code")?,
            pid_pos_now: reader.f64("state.pid_pos_now")?,
            controller_id: reader.i32("state.controller_id")?,
            ntc_temp_mos1: reader.f64("state.ntc_temp_mos1")?,
            ntc_temp_mos2: reader.f64("state.ntc_temp_mos2")?,
            ntc_temp_mos3: reader.f64("state.ntc_temp_mos3")?,
            avg_vd: reader.f64("state.avg_vd")?,
            avg_vq: reader.f64("state.avg_vq")?,
        };
        reader.finish("state.avg_vq")?;
        Ok(Self { header, state })
    }

    fn write(&self, writer: &mut CdrWriter) {
        let of = &self.state;
        self.header.write(writer);
        writer.f64_array(&[
            of.temp_fet,
            of.temp_motor,
            of.current_motor,
            of.current_input,
            of.avg_id,
            of.avg_iq,
            of.duty_cycle,
            of.speed,
            of.voltage_input,
            of.charge_drawn,
            of.charge_regen,
            of.energy_drawn,
            of.energy_regen,
        ]);
        writer.i32(of.displacement);
        writer.i32(of.distance_traveled);
        writer.i32(of.fault_code);
        writer.f64(of.pid_pos_now);
        writer.i32(of.controller_id);
        writer.f64_array(&[of.ntc_temp_mos1, of.ntc_temp_mos2, of.ntc_temp_mos3]);
        writer.f64_array(&[of.avg_vd, of.avg_vq]);
    }

    fn body_bytes(&self) -> usize {
        self.header.body_bytes() + 8 * 23
    }
}

/// The motor's electrical speed, revolutions per minute: `speed_gear` is the reciprocal of the
/// driver's `speed_to_erpm_gain`.
impl WheelMessage for VescStateStamped {
    fn wheels(self, _joints: Option<&Joints>) -> Wheels {
        Wheels {
            header: Some(self.header),
            steering: Err(Unstated::ByType),
            speed: Ok(self.state.speed),
            yaw_rate_radps: None,
        }
    }
}
