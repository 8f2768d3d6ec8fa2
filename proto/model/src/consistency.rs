//! Consistency of the filter: whether the model explains the data.

use serde::{Deserialize, Serialize};

use crate::time::RobotTime;

/// Consistency of the filter's innovations with the covariance that the configured noise implies.
///
/// A filter that learns its noise makes any model look consistent: the normalisation here is that
/// of the noise as configured, so that errors beyond it show.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Consistency {
    /// Mean normalised innovation squared over the recent updates, with the noise as configured.
    pub nis_mean: f64,
    /// Its expectation: the degrees of freedom of one update.
    pub nis_dof: f64,
    /// Number of updates in the mean.
    pub samples: u64,
    /// Lowest and highest `nis_mean` of 95 % of all vehicles with exactly the configured noise, by
    /// the chi-square distribution; absent before the first update, and in documents of older
    /// services.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nis_range: Option<[f64; 2]>,
    /// Fit of the model to the data; absent before there are enough updates, and in documents
    /// of older services.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fit: Option<ModelFit>,
    /// Innovation of the latest update; absent before the first, and in documents of older services.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub innovation: Option<Innovation>,
}

/// Noise that a normalised innovation squared is by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum NisNoise {
    /// The noise as configured. Records of older services name none: they had the noise that the
    /// filter had learnt.
    Configured,
}

/// Fit of the model to the data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum ModelFit {
    /// Innovations are at most as large as the configured noise.
    Explained,
    /// Innovations are larger: the noise was learnt, and the sigmas are wider for it.
    Rough,
    /// Innovations are so large that noise is no explanation: the configuration or a sensor is wrong.
    Unexplained,
}

/// Innovation of one update: the measured motion of the LiDAR less the predicted one, along the axes
/// of the LiDAR.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Innovation {
    /// Time of the update, ns since 1970, by the robot's clock.
    pub stamp_ns: RobotTime,
    /// Innovation forwards (m), to the left (m) and in yaw (rad).
    pub residual: [f64; 3],
    /// Standard deviations that the configured noise implies for them, in the same units.
    pub sigma: [f64; 3],
}

/// Share of the normal distribution's two tails outside of ±1.96 is 5 %.
const Z_95: f64 = 1.96;
/// Updates from which the fit is judged: a mean of fewer says little.
const JUDGED_FROM: u64 = 50;
/// Ratio of `nis_mean` to its expectation beyond which noise is no explanation: errors five times as
/// large as configured.
const UNEXPLAINED_BEYOND: f64 = 25.0;

impl Consistency {
    /// Makes the consistency of a mean over `samples` updates of `nis_dof` degrees of freedom each.
    pub fn of(nis_mean: f64, nis_dof: f64, samples: u64, innovation: Option<Innovation>) -> Self {
        let nis_range = (samples > 0).then(|| mean_chi_square_range(nis_dof, samples));
        let fit = nis_range
            .filter(|_| samples >= JUDGED_FROM)
            .map(|[_, highest]| {
                if nis_mean <= highest {
                    ModelFit::Explained
                } else if nis_mean <= UNEXPLAINED_BEYOND * nis_dof {
                    ModelFit::Rough
                } else {
                    ModelFit::Unexplained
                }
            });
        Self {
            nis_mean,
            nis_dof,
            samples,
            nis_range,
            fit,
            innovation,
        }
    }

    /// Returns the noise that `nis_mean` is by; `None` for the learnt noise of an older service, and
    /// before the first update.
    pub fn nis_noise(&self) -> Option<NisNoise> {
        self.nis_range.map(|_| NisNoise::Configured)
    }

    /// True if every number is finite.
    pub fn is_finite(&self) -> bool {
        let of_innovation = self.innovation.iter().flat_map(|innovation| {
            let Innovation {
                residual, sigma, ..
            } = innovation;
            residual.iter().chain(sigma)
        });
        self.nis_mean.is_finite() && of_innovation.copied().all(f64::is_finite)
    }

    /// Returns the size of the errors as a multiple of the expected size: the root of the ratio of
    /// `nis_mean` to its expectation.
    pub fn errors_over_expected(&self) -> f64 {
        if self.nis_dof > 0.0 {
            (self.nis_mean / self.nis_dof).sqrt()
        } else {
            0.0
        }
    }
}

/// Returns the 2.5 % and the 97.5 % quantile of the mean of `samples` chi-square values of `dof`
/// degrees of freedom each, by the approximation of Wilson and Hilferty.
fn mean_chi_square_range(dof: f64, samples: u64) -> [f64; 2] {
    let spread = 2.0 / (9.0 * dof * samples as f64);
    [-Z_95, Z_95].map(|z| dof * (1.0 - spread + z * spread.sqrt()).max(0.0).powi(3))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_range_is_that_of_the_tables_of_chi_square() {
        // Quantiles of 3, 30 and 600 degrees of freedom, over the number of updates.
        let tables = [
            (1, [0.216, 9.348]),
            (10, [1.679, 4.698]),
            (200, [2.670, 3.349]),
        ];
        for (samples, expected) in tables {
            let got = mean_chi_square_range(3.0, samples);
            for (got, expected) in got.into_iter().zip(expected) {
                assert!((got - expected).abs() < 0.06, "{samples}: {got} {expected}");
            }
        }
    }

    #[test]
    fn a_mean_of_few_updates_is_not_judged() {
        let fit = |nis_mean, samples| Consistency::of(nis_mean, 3.0, samples, None).fit;
        assert_eq!(fit(1_000.0, 10), None);
        assert_eq!(fit(1.2, 200), Some(ModelFit::Explained));
        assert_eq!(fit(9.0, 200), Some(ModelFit::Rough));
        assert_eq!(fit(1_000.0, 200), Some(ModelFit::Unexplained));
    }

    #[test]
    fn documents_of_older_services_are_read() {
        let older = r#"{"nis_mean": 3.0, "nis_dof": 3.0, "samples": 10}"#;
        let read: Consistency = serde_json::from_str(older).unwrap();
        assert_eq!(
            (read.nis_range, read.fit, read.innovation),
            (None, None, None)
        );
        assert_eq!(read.nis_noise(), None);
        let now = Consistency::of(3.0, 3.0, 10, None);
        assert_eq!(now.nis_noise(), Some(NisNoise::Configured));
    }
}
