//! Ranking of the manoeuvres a robot could drive next, in the order of the information that each
//! would add for this robot now, for the way it needs and on the floor there is.

use super::manoeuvre::Manoeuvre;
use super::{APPROACH_M, Advice, Knowledge, advise};
use crate::estimate::Parameter;
use crate::filter::{ParameterCovariance, Values};
use crate::settings::{EstimatorSettings, Freedom};

/// Share of a parameter's uncertainty that a manoeuvre worth asking for removes.
const WORTH_SHARE: f64 = 0.1;

/// Free floor, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Floor {
    /// One side.
    pub length_m: f64,
    /// The other.
    pub width_m: f64,
}

impl Floor {
    /// True if a manoeuvre fits, one way round or the other.
    pub fn fits(&self, manoeuvre: &Manoeuvre) -> bool {
        let [long, wide] = manoeuvre.space_m;
        let holds = |length_m, width_m| long <= length_m && wide <= width_m;
        holds(self.length_m, self.width_m) || holds(self.width_m, self.length_m)
    }
}

/// A manoeuvre and its worth.
#[derive(Debug, Clone, PartialEq)]
pub struct Ranked {
    /// The manoeuvre and the knowledge after it.
    pub advice: Advice,
    /// Factor by which the standard deviations that are too large for `converged` shrink, all in
    /// all, as a natural logarithm. 0 when none is too large or the manoeuvre shows nothing of
    /// them.
    pub uncertainty_taken: f64,
    /// Information about all estimated parameters, bits.
    pub information_bits: f64,
}

impl Ranked {
    /// Uncertainty removed and information for each metre, the way to the manoeuvre included.
    fn per_metre(&self) -> [f64; 2] {
        let way_m = APPROACH_M + self.advice.manoeuvre.distance_m();
        [
            self.uncertainty_taken / way_m,
            self.information_bits / way_m,
        ]
    }

    fn surface_m2(&self) -> f64 {
        let [long, wide] = self.advice.manoeuvre.space_m;
        long * wide
    }
}

/// All manoeuvres that fit on the floor, the best first.
///
/// The order is by the uncertainty that still keeps parameters from `converged`, for each metre
/// driven; where nothing is missing any more, by information for each metre; and between equals by
/// the smaller floor. Without `floor` every manoeuvre fits.
pub fn rank(knowledge: &Knowledge, floor: Option<Floor>) -> Vec<Ranked> {
    let sigma_now = Values::from_fn(|i, _| knowledge.covariance[(i, i)].sqrt());
    let fits = |advice: &Advice| floor.is_none_or(|floor| floor.fits(&advice.manoeuvre));
    let mut ranked: Vec<_> = advise(knowledge)
        .into_iter()
        .filter(fits)
        .map(|advice| Ranked {
            uncertainty_taken: uncertainty(&sigma_now, knowledge.settings)
                - uncertainty(&advice.sigma_after, knowledge.settings),
            information_bits: information_bits(
                knowledge.covariance,
                &advice.covariance_after,
                knowledge.settings,
            ),
            advice,
        })
        .collect();
    ranked.sort_by(|a, b| {
        let ([a_uncertainty, a_bits], [b_uncertainty, b_bits]) = (a.per_metre(), b.per_metre());
        b_uncertainty
            .total_cmp(&a_uncertainty)
            .then(b_bits.total_cmp(&a_bits))
            .then(a.surface_m2().total_cmp(&b.surface_m2()))
    });
    ranked
}

/// The first manoeuvre of a ranking that is worth driving for a parameter; `None` when none removes
/// a tenth of its uncertainty. So all parameters ask for the first of the ranking, where that helps
/// them: nobody has to drive another one for each.
pub fn first_for(parameter: Parameter, sigma_now: f64, ranked: &[Ranked]) -> Option<&Advice> {
    let i = parameter.index();
    let mut advice = ranked.iter().map(|one| &one.advice);
    advice.find(|advice| advice.sigma_after[i] < (1.0 - WORTH_SHARE) * sigma_now)
}

/// Excess of the estimated parameters' standard deviations over their limits for `converged`, as a
/// sum of natural logarithms.
fn uncertainty(sigma: &Values, settings: &EstimatorSettings) -> f64 {
    let estimated = Parameter::ALL
        .into_iter()
        .filter(|parameter| settings.freedom(*parameter) == Freedom::Estimated);
    estimated
        .map(|parameter| {
            let limit = settings.converged_sigma.get(parameter);
            (sigma[parameter.index()] / limit).ln().max(0.0)
        })
        .sum()
}

/// Information about the estimated parameters between two states of knowledge, bits:
/// `log2(det P_before / det P_after) / 2`.
pub fn information_bits(
    before: &ParameterCovariance,
    after: &ParameterCovariance,
    settings: &EstimatorSettings,
) -> f64 {
    let log_det = |covariance: &ParameterCovariance| {
        // What is not estimated stands as certain and independent: it adds nothing.
        let mut estimated = *covariance;
        for i in 0..estimated.nrows() {
            let parameter = Parameter::ALL.get(i);
            let counts = parameter.is_some_and(|&p| settings.freedom(p) == Freedom::Estimated);
            if !counts {
                estimated.row_mut(i).fill(0.0);
                estimated.column_mut(i).fill(0.0);
                estimated[(i, i)] = 1.0;
            }
        }
        let factor = estimated.cholesky()?;
        Some(2.0 * factor.l_dirty().diagonal().map(f64::ln).sum())
    };
    match (log_det(before), log_det(after)) {
        (Some(before), Some(after)) => 0.5 * (before - after) / std::f64::consts::LN_2,
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::prior::Prior;
    use crate::geometry::Pose2;
    use crate::vehicle::{Vehicle, VehicleModel};

    /// Ranking for a tugger whose mount is known from CAD, and more of some parameters.
    fn ranked(known: &[(Parameter, f64)], floor: Option<Floor>) -> Vec<Ranked> {
        let vehicle = Vehicle::new(VehicleModel::Bicycle, 1.2);
        let settings = EstimatorSettings::default();
        let cad = Some(Pose2::new(0.434, 0.0, 0.0));
        let mut prior = Prior::cold(&vehicle, cad, &settings);
        for (parameter, sigma) in known {
            prior.covariance[(parameter.index(), parameter.index())] = sigma * sigma;
        }
        let knowledge = Knowledge {
            vehicle: &vehicle,
            values: &prior.values,
            covariance: &prior.covariance,
            settings: &settings,
        };
        rank(&knowledge, floor)
    }

    #[test]
    fn an_unknown_mount_wants_turns_to_both_sides() {
        let ranked = ranked(&[], None);
        let best = ranked[0].advice.manoeuvre.name;
        assert!(
            ["left_turn", "right_turn", "s_curve", "figure_eight"].contains(&best),
            "{best}"
        );
        let sigma_x = |name: &str| {
            let mut found = ranked.iter().filter(|r| r.advice.manoeuvre.name == name);
            found.next().unwrap().advice.sigma_after[Parameter::LidarX.index()]
        };
        assert!(sigma_x("straight") > 0.09 && sigma_x(best) < 0.03);
    }

    /// Manoeuvre that a parameter asks for, of a tugger with this knowledge.
    fn asked(parameter: Parameter, known: &[(Parameter, f64)]) -> &'static str {
        let ranked = ranked(known, None);
        let sigma_now = known.iter().find(|(one, _)| *one == parameter);
        let prior = Prior::cold(
            &Vehicle::new(VehicleModel::Bicycle, 1.2),
            Some(Pose2::new(0.434, 0.0, 0.0)),
            &EstimatorSettings::default(),
        );
        let i = parameter.index();
        let sigma_now = sigma_now.map_or(prior.covariance[(i, i)].sqrt(), |(_, sigma)| *sigma);
        let first = first_for(parameter, sigma_now, &ranked).unwrap();
        first.manoeuvre.name
    }

    #[test]
    fn a_mount_needs_turns_and_a_clock_needs_changing_speed() {
        let known = [
            (Parameter::SteeringOffset, 0.001),
            (Parameter::LidarYaw, 0.001),
        ];
        assert!(
            ["left_turn", "right_turn", "s_curve", "left_circle"]
                .contains(&asked(Parameter::LidarX, &known))
        );
        let mount = [
            (Parameter::SteeringOffset, 1e-4),
            (Parameter::LidarX, 1e-3),
            (Parameter::LidarY, 1e-3),
            (Parameter::LidarYaw, 1e-4),
            (Parameter::SpeedScale, 1e-3),
        ];
        assert_eq!(asked(Parameter::TimeOffset, &mount), "stop_and_go");
    }

    #[test]
    fn every_parameter_asks_for_what_the_ranking_has_first_where_that_helps() {
        let [first, ..] = &ranked(&[], None)[..] else {
            panic!("nothing is ranked");
        };
        let first = first.advice.manoeuvre.name;
        for parameter in [
            Parameter::SteeringOffset,
            Parameter::LidarX,
            Parameter::LidarY,
            Parameter::LidarYaw,
            Parameter::SpeedScale,
        ] {
            assert_eq!(asked(parameter, &[]), first, "{parameter:?}");
        }
        assert!(first_for(Parameter::LidarX, 1e-9, &ranked(&[], None)).is_none());
    }

    #[test]
    fn only_what_fits_is_offered_either_way_round() {
        let aisle = Floor {
            length_m: 1.5,
            width_m: 20.0,
        };
        let ranked = ranked(&[], Some(aisle));
        let names: Vec<_> = ranked.iter().map(|r| r.advice.manoeuvre.name).collect();
        assert!(
            names.contains(&"straight") && names.contains(&"reverse"),
            "{names:?}"
        );
        assert!(!names.contains(&"figure_eight") && !names.contains(&"left_turn"));
    }

    #[test]
    fn where_all_is_known_nothing_is_worth_a_way_but_information_still_orders() {
        let known = [
            (Parameter::SteeringOffset, 1e-4),
            (Parameter::LidarX, 1e-3),
            (Parameter::LidarY, 1e-3),
            (Parameter::LidarYaw, 1e-4),
            (Parameter::SpeedScale, 1e-3),
            (Parameter::TimeOffset, 1e-3),
        ];
        let ranked = ranked(&known, None);
        assert!(
            ranked
                .iter()
                .all(|ranked| ranked.uncertainty_taken.abs() < 1e-12)
        );
        assert!(ranked[0].information_bits > 0.0);
        let per_metre: Vec<_> = ranked.iter().map(|ranked| ranked.per_metre()[1]).collect();
        assert!(per_metre.windows(2).all(|pair| pair[0] >= pair[1]));
    }

    #[test]
    fn halving_one_sigma_is_one_bit() {
        let settings = EstimatorSettings::default();
        let before = ParameterCovariance::identity();
        let mut after = before;
        let x = Parameter::LidarX.index();
        after[(x, x)] = 0.25;
        assert!((information_bits(&before, &after, &settings) - 1.0).abs() < 1e-12);
        // What is not estimated does not count.
        let gain = Parameter::SteeringGain.index();
        after[(gain, gain)] = 0.01;
        assert!((information_bits(&before, &after, &settings) - 1.0).abs() < 1e-12);
    }
}
