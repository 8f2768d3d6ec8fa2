//! `fleetcal_msgs/msg/Estimate`: an estimate as recordings have it. Its definition is written into
//! each recording, so that readers need no package of it.

use serde::{Deserialize, Serialize};

use super::{Header, RosMessage};
use crate::cdr::{CdrError, CdrReader, CdrWriter};

/// Most parameters of a message.
const PARAMETERS_MAX: usize = 64;
/// Fewest bytes of a parameter in CDR.
const PARAMETER_BYTES_MIN: usize = 32;

/// Estimate of a robot's parameters.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Estimate {
    /// Stamp, and the frame that the LiDAR's pose is in.
    pub header: Header,
    /// The parameters, at most 64.
    pub parameters: Vec<ParameterEstimate>,
    /// The whole estimate in JSON, as `GET /robots/{id}/estimate` returns it.
    pub document: String,
}

/// Estimate of one parameter.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ParameterEstimate {
    /// Name of the parameter, `lidar_yaw`.
    pub name: String,
    /// Value, in SI units.
    pub value: f64,
    /// Standard deviation, in the unit of the value.
    pub sigma: f64,
    /// Status of the estimate, `converged`.
    pub status: String,
}

impl RosMessage for Estimate {
    const TYPE: &'static str = "fleetcal_msgs/msg/Estimate";

    fn read(mut reader: CdrReader<'_>) -> Result<Self, CdrError> {
        let header = Header::read(&mut reader)?;
        let parameters = reader.sequence(
            "parameters",
            PARAMETER_BYTES_MIN,
            PARAMETERS_MAX,
            |reader| {
                Ok(ParameterEstimate {
                    name: reader.string("parameters.name")?,
                    value: reader.f64("parameters.value")?,
                    sigma: reader.f64("parameters.sigma")?,
                    status: reader.string("parameters.status")?,
                })
            },
        )?;
        let document = reader.string("document")?;
        reader.finish("document")?;
        Ok(Self {
            header,
            parameters,
            document,
        })
    }

    fn write(&self, writer: &mut CdrWriter) {
        self.header.write(writer);
        writer.sequence_length(self.parameters.len());
        for parameter in &self.parameters {
            writer.string(&parameter.name);
            writer.f64(parameter.value);
            writer.f64(parameter.sigma);
            writer.string(&parameter.status);
        }
        writer.string(&self.document);
    }

    fn body_bytes(&self) -> usize {
        let bytes = |of: &ParameterEstimate| of.name.len() + of.status.len() + 48;
        let parameters: usize = self.parameters.iter().map(bytes).sum();
        self.header.body_bytes() + parameters + self.document.len() + 16
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros::{Log, Time};

    #[test]
    fn what_is_recorded_beside_the_streams_reads_as_it_was_written() {
        let parameter = |name: &str| ParameterEstimate {
            name: name.to_owned(),
            value: -0.25,
            sigma: 1e-3,
            status: "converged".to_owned(),
        };
        let mut estimate = Estimate {
            parameters: vec![parameter("lidar_x"), parameter("y")],
            document: "{}".to_owned(),
            ..Estimate::default()
        };
        assert_eq!(Estimate::from_cdr(&estimate.to_cdr()).unwrap(), estimate);
        estimate.parameters = vec![parameter(""); PARAMETERS_MAX + 1];
        assert!(Estimate::from_cdr(&estimate.to_cdr()).is_err());

        let mut log = Log {
            stamp: Time { sec: 7, nanosec: 8 },
            level: Log::WARN,
            msg: "steering offset changed".to_owned(),
            ..Log::default()
        };
        assert_eq!(Log::from_cdr(&log.to_cdr()).unwrap(), log);
        log.stamp.nanosec = 1_000_000_000;
        assert!(Log::from_cdr(&log.to_cdr()).is_err());
    }
}
