//! Long-run variance: the filter's claims against the scatter of disjoint blocks.
//!
//! On a real vehicle the errors of neighbouring windows are not independent: slip, play, load and
//! floor last for metres. Each block of some metres pulls the parameters its own way, by
//! `u = P J' S^-1 r`; if the noise were as the filter assumes it, `u` would have the covariance
//! `P J' S^-1 J P`. The ratio of the two, summed over the blocks, is how much larger a parameter's
//! variance really is (the sandwich estimator with clusters, of White and of Liang and Zeger). It
//! widens what is claimed and raises the evidence that a change needs.

use nalgebra::{Matrix3, SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::block::Block;
use super::window::Window;
use crate::estimate::Parameter;
use crate::filter::relevance::Known;
use crate::filter::{Filter, PARAMETERS, ParameterCovariance, Values, apart, padded, symmetric};

/// Windows in a block: errors that last longer than some 5 m are for the change test to judge.
const BLOCK: usize = 10;
/// Blocks that are remembered.
const MEMORY_BLOCKS: f64 = 60.0;
/// Fewest blocks, some 20 m, before the scatter is believed to be small.
const BLOCKS_MIN: f64 = 5.0;
/// Blocks before changes are checked for visibility: fewer show too little of the scatter.
const SEE_BLOCKS: f64 = 8.0;
/// Number of blocks up to which a change needs [`FEW_BLOCKS_CAUTION`] times the evidence: on one
/// lap of its route a robot that does not obey its model has not shown yet by how much. Blocks are
/// counted as they are remembered, so that the tenth is the last; before the fifth nothing is
/// claimed, and nothing judged.
const FEW_BLOCKS: f64 = 10.0;
/// Factor of the evidence for [`FEW_BLOCKS`].
const FEW_BLOCKS_CAUTION: f64 = 2.0;
/// Ratio until then: five times the standard deviation.
const UNPROVEN_RATIO: f64 = 25.0;
/// Share of the worst ratio that every parameter has at least: lasting errors are seldom one's
/// alone.
const SHARED: f64 = 0.5;
/// Multiple of an excess of scatter that is added to it where it is known from one block alone.
const UNCERTAINTY_BLOCKS: f64 = 6.0;
/// Fewest blocks by which the leverage is bounded: the first block is fitted as if it were the only
/// one.
const LEVERAGE_BLOCKS_MIN: f64 = 2.0;
/// Largest addition by errors that outlast blocks: an exponential memory of a whole block's length.
const LASTING_MAX: f64 = 2.7;
/// Four sigmas of `n` blocks are as rare as four of many when the variance is larger by `1 + 14 / n`;
/// [`UNCERTAINTY_BLOCKS`] has its part of it already.
const STUDENT_BLOCKS: f64 = 8.0;
/// Largest squared error of a block or a window, in its variances: a fault is no noise.
const SQUARE_MAX: f64 = 400.0;
/// Squared error (three degrees of freedom) from which a block is wild: of pure noise, about one in
/// 135 is.
const WILD_SQUARE: f64 = 12.0;
/// Weight below which a wild block waits no longer for another one: that would be chance.
const WILD_WEIGHT_MIN: f64 = 0.5;
/// Parameters whose changes a lone wild block does not hide. For the others it counts at once, as
/// it may be slip, or steering that does not obey the model, and so it does for the claims of all.
const OF_THE_MOUNT: [Parameter; 3] = [Parameter::LidarX, Parameter::LidarY, Parameter::LidarYaw];

/// Expectation of a filter before a window.
#[derive(Debug, Clone, Copy)]
struct Expectation {
    /// Scale of the noise (as a variance, over the configured one).
    scale: f64,
    /// [`surprise`].
    surprise: f64,
}

/// The squared residual of a window as a filter expected it before the window.
fn surprise(window: &Window, before: &Filter) -> Option<f64> {
    let residual = window.residual + window.jacobian * apart(&window.values, before.values());
    let covariance = window.covariance * before.noise_scale()
        + window.jacobian * before.parameter_covariance() * window.jacobian.transpose();
    let square = residual.dot(&covariance.cholesky()?.solve(&residual));
    Some(square.min(SQUARE_MAX))
}

/// Learns how far the filter's claims are from the scatter of blocks of data.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct LongRunVariance {
    whole: Clusters,
    /// The same over blocks half as long.
    half: Clusters,
}

/// Scatter of a robot's data against one covariance of its parameters.
#[derive(Debug, Clone, Copy)]
pub struct Scatter<'a> {
    long_run: &'a LongRunVariance,
    covariance: &'a ParameterCovariance,
    ratios: Values,
    /// The ratios without a lone wild block; `None` where there is none.
    tame: Option<Values>,
}

/// Scatter of blocks of one length.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
struct Clusters {
    block: Option<Block>,
    /// Sum of `J' S^-1 r r' S^-1 J` over the blocks.
    #[serde(with = "padded")]
    scatter: SMatrix<f64, PARAMETERS, PARAMETERS>,
    /// Sum of `J' S^-1 J`: the expected scatter.
    #[serde(with = "padded")]
    expected: SMatrix<f64, PARAMETERS, PARAMETERS>,
    blocks: f64,
    /// A wild block that waits for another one.
    #[serde(default)]
    wild: Option<Wild>,
}

/// A wild block's part of the scatter, which raises the evidence that a change of the LiDAR's mount
/// needs once there is another one. A LiDAR that is moved jumps once. On a straight nothing else
/// shows until the next turn, and if the block of the jump counted as scatter by then, the change
/// would pass for noise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Wild {
    #[serde(with = "padded")]
    scatter: SMatrix<f64, PARAMETERS, PARAMETERS>,
    /// Rest of it in the memory.
    weight: f64,
}

impl Clusters {
    /// Adds the next window of a block of `length`.
    fn push(&mut self, window: &Window, length: usize, values: &Values, expected: Expectation) {
        let Expectation { scale, surprise } = expected;
        let before = self.block.take();
        let block = before
            .and_then(|before| before.extended(window, values, surprise))
            .unwrap_or_else(|| Block::begin(window, values, surprise));
        if block.windows < length {
            self.block = Some(block);
        } else {
            let covariance = (block.covariance + window.end_covariance) * scale;
            self.learn(&block, &covariance);
        }
    }

    fn learn(&mut self, block: &Block, covariance: &Matrix3<f64>) {
        let Some(factor) = covariance.cholesky() else {
            return;
        };
        let error = block.error();
        let weighed = factor.solve(error);
        let square = error.dot(&weighed);
        let score: SVector<f64, PARAMETERS> = block.jacobian.tr_mul(&weighed);
        let kept = 1.0 - 1.0 / MEMORY_BLOCKS;
        let weight = SQUARE_MAX / square.max(SQUARE_MAX) / (1.0 - self.leverage());
        let own = score * score.transpose() * weight;
        self.note_wild(&own, square, kept);
        self.scatter = rounded(self.scatter * kept + own);
        let information = block.jacobian.tr_mul(&factor.solve(&block.jacobian));
        self.expected = rounded(self.expected * kept + symmetric(&information));
        self.blocks = self.blocks * kept + 1.0;
    }

    /// Keeps a wild block aside until the next one comes, or until it weighs less than half.
    fn note_wild(&mut self, own: &SMatrix<f64, PARAMETERS, PARAMETERS>, square: f64, kept: f64) {
        let is_wild = square >= WILD_SQUARE && self.blocks >= FEW_BLOCKS;
        self.wild = match self.wild.take() {
            None if is_wild => Some(Wild {
                scatter: rounded(*own),
                weight: 1.0,
            }),
            Some(Wild { scatter, weight }) if !is_wild && weight * kept > WILD_WEIGHT_MIN => {
                Some(Wild {
                    scatter: rounded(scatter * kept),
                    weight: weight * kept,
                })
            }
            _ => None,
        };
    }

    /// Share of the next block in the values that it is compared with: they were fitted to it too,
    /// so that it scatters by so much less than it errs.
    fn leverage(&self) -> f64 {
        1.0 / (self.blocks + 1.0).max(LEVERAGE_BLOCKS_MIN)
    }

    /// Ratio of each parameter's observed variance to the one of the filter's `covariance`.
    fn seen_over_said(&self, covariance: &ParameterCovariance) -> Values {
        Values::from_fn(|i, _| self.over_said(&self.scatter, i, covariance))
    }

    /// The same without a lone wild block; `None` where there is none.
    fn tame_over_said(&self, covariance: &ParameterCovariance) -> Option<Values> {
        let scatter = self.scatter - self.wild.as_ref()?.scatter;
        Some(Values::from_fn(|i, _| {
            self.over_said(&scatter, i, covariance)
        }))
    }

    /// The same of one parameter, by this scatter. Rounding may leave it below zero.
    fn over_said(
        &self,
        scatter: &SMatrix<f64, PARAMETERS, PARAMETERS>,
        i: usize,
        covariance: &ParameterCovariance,
    ) -> f64 {
        let by = covariance.column(i).into_owned();
        let [seen, said] = [scatter, &self.expected].map(|sum| by.dot(&(sum * by)));
        if said > 0.0 { seen / said } else { 1.0 }
    }
}

/// The ratios, each at least [`SHARED`] of the worst, and at least 1.
fn shared(ratios: &Values) -> Values {
    let least = (SHARED * ratios.max()).max(1.0);
    ratios.map(|ratio| ratio.max(least))
}

/// Rounds to single precision, with which a checkpoint is a fifth smaller: the evidence of some
/// tens of blocks is known to one digit.
fn rounded<const N: usize>(sum: SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    sum.map(|value| f64::from(value as f32))
}

impl LongRunVariance {
    /// Adds the next window, by the present parameters, and with the filter as it was before that
    /// window.
    pub fn push(&mut self, window: &Window, values: &Values, before: &Filter) {
        let expected = Expectation {
            scale: before.noise_scale(),
            surprise: surprise(window, before).unwrap_or(SQUARE_MAX),
        };
        self.push_expected(window, values, expected);
    }

    fn push_expected(&mut self, window: &Window, values: &Values, expected: Expectation) {
        self.whole.push(window, BLOCK, values, expected);
        self.half.push(window, BLOCK / 2, values, expected);
    }

    /// Breaks the block: the next window does not continue the last.
    pub fn break_block(&mut self) {
        self.whole.block = None;
        self.half.block = None;
    }

    /// Scatter of the data against a filter's `covariance`.
    pub fn scatter<'a>(&'a self, covariance: &'a ParameterCovariance) -> Scatter<'a> {
        Scatter::new(self, covariance)
    }

    /// Knowledge of a filter's parameters, given the scatter of its data.
    pub fn known(&self, filter: &Filter) -> Known {
        filter.known(self.scatter(&filter.parameter_covariance()).ratios())
    }

    /// True if enough blocks were counted to decide whether a change would stand out from their
    /// scatter.
    pub fn is_well_known(&self) -> bool {
        self.whole.blocks > SEE_BLOCKS
    }

    /// True if blocks enough were counted that a change needs no more evidence for their small number.
    pub fn has_shown_scatter(&self) -> bool {
        self.whole.blocks > FEW_BLOCKS
    }

    /// Factor of the evidence that a change needs because only few blocks have shown their scatter
    /// yet.
    pub fn caution(&self) -> f64 {
        if self.has_shown_scatter() {
            1.0
        } else {
            FEW_BLOCKS_CAUTION
        }
    }

    /// True if enough blocks were counted to distinguish their scatter from a change, and to claim
    /// anything.
    pub fn is_known(&self) -> bool {
        self.whole.blocks > BLOCKS_MIN - 0.5
    }
}

impl<'a> Scatter<'a> {
    fn new(long_run: &'a LongRunVariance, covariance: &'a ParameterCovariance) -> Self {
        let clusters = &long_run.whole;
        Self {
            long_run,
            covariance,
            ratios: shared(&clusters.seen_over_said(covariance)),
            tame: clusters
                .tame_over_said(covariance)
                .map(|tame| shared(&tame)),
        }
    }

    fn blocks(&self) -> f64 {
        self.long_run.whole.blocks
    }

    /// Ratio of each parameter's variance to the filter's; at least 1.
    pub fn ratios(&self) -> &Values {
        &self.ratios
    }

    /// Factor of the variance of the speed scale over that by [`Self::ratios`], because slip lasts
    /// longer than a block: blocks of `b` windows show too little by a share of `1 / b`, which the
    /// half blocks show: `2 R(b) - R(b/2)` (batch means with a lugsail window, of Vats and Flegal).
    fn lasting_slip(&self) -> f64 {
        let i = Parameter::SpeedScale.index();
        let [whole, half] = [&self.long_run.whole, &self.long_run.half]
            .map(|clusters| clusters.over_said(&clusters.scatter, i, self.covariance));
        ((2.0 * whole - half) / self.ratios[i]).clamp(1.0, LASTING_MAX)
    }

    /// Ratios with the uncertainty of a scatter that is itself known from a few blocks only.
    fn uncertain(&self, ratios: &Values) -> Values {
        let uncertainty = 1.0 + UNCERTAINTY_BLOCKS / self.blocks().max(1.0);
        ratios.map(|ratio| 1.0 + uncertainty * (ratio - 1.0))
    }

    /// Ratios by which the evidence for a change of each parameter has to be larger, before it
    /// passes a `threshold` that is meant for a scatter which is known well: the ratios with their
    /// uncertainty. Slip looks like another wheel; where it was seen, evidence so rare is
    /// Student's, who knows the scatter from `n` blocks alone: `t^2 = n (exp(z^2 / n) - 1)`. For
    /// the mount a lone wild block does not count.
    pub fn alarm_ratios(&self, threshold: f64) -> Values {
        let mut ratios = self.uncertain(&self.ratios);
        if let Some(tame) = &self.tame {
            let tame = self.uncertain(tame);
            for i in OF_THE_MOUNT.map(Parameter::index) {
                ratios[i] = tame[i];
            }
        }
        let i = Parameter::SpeedScale.index();
        let blocks = self.blocks().max(BLOCKS_MIN);
        let student = blocks / threshold * (threshold / blocks).exp_m1();
        let slipping = self.ratios[i] - 1.0;
        ratios[i] = ratios[i].max(1.0 + slipping * student);
        ratios
    }

    /// Largest factor of a single window's limit where a lone wild block does not count: else its
    /// addition to the other causes would let one window accuse the mount. Infinite where there is
    /// none.
    pub fn window_ratio_max(&self) -> f64 {
        self.tame.as_ref().map_or(f64::INFINITY, |tame| {
            let tame = self.uncertain(tame);
            let least = OF_THE_MOUNT.map(|parameter| tame[parameter.index()]);
            least.into_iter().fold(f64::INFINITY, f64::min) / SHARED
        })
    }

    /// Factors of the errors that may be claimed.
    pub fn claim_widths(&self) -> Values {
        let least = if self.long_run.is_known() {
            1.0
        } else {
            UNPROVEN_RATIO
        };
        self.uncertain(&self.ratios)
            .map(|ratio| ratio.max(least).sqrt())
    }

    /// The covariance that may be claimed.
    pub fn claim(&self) -> ParameterCovariance {
        widened(self.covariance, &self.claim_widths())
    }

    /// Factors by which published errors are larger than claimed ones: slip that outlasts blocks,
    /// and where blocks scatter more than by the filter, four sigmas are Student's, who knows them
    /// from these blocks alone: half a minute of a real tricycle has three of them.
    pub fn publish_widths(&self) -> Values {
        let mut variances = self.ratios.map(|ratio| {
            let scattering = 1.0 - 1.0 / ratio;
            1.0 + scattering * STUDENT_BLOCKS / self.blocks().max(1.0)
        });
        variances[Parameter::SpeedScale.index()] *= self.lasting_slip();
        variances.map(f64::sqrt)
    }
}

/// The covariance of errors that are so many times larger, each.
pub fn widened(covariance: &ParameterCovariance, widths: &Values) -> ParameterCovariance {
    ParameterCovariance::from_fn(|i, j| widths[i] * covariance[(i, j)] * widths[j])
}

#[cfg(test)]
pub(super) mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::change::evidence::{Evidence, Innovation, Thresholds};
    use crate::change::window::Track;
    use crate::filter::constraint::ByParameters;
    use crate::filter::prior::Prior;
    use crate::settings::EstimatorSettings;
    use crate::stream::RobotTime;
    use crate::vehicle::{Vehicle, VehicleModel};

    fn publish(scatter: &Scatter) -> ParameterCovariance {
        widened(&scatter.claim(), &scatter.publish_widths())
    }

    fn ratio(error: impl Fn(usize) -> f64) -> f64 {
        let variance = learnt(Parameter::LidarX, error);
        variance.scatter(&ParameterCovariance::identity()).ratios()[Parameter::LidarX.index()]
    }

    /// Learns from windows whose poses are exact and whose motion errs along the track as given,
    /// where one parameter shows.
    fn learnt(parameter: Parameter, error: impl Fn(usize) -> f64) -> LongRunVariance {
        learnt_from(2000, parameter, error)
    }

    fn learnt_from(
        windows: usize,
        parameter: Parameter,
        error: impl Fn(usize) -> f64,
    ) -> LongRunVariance {
        learnt_by(windows, parameter, error, |_| 0.0, 3.0)
    }

    /// Learns the same while the parameter, which is zero, has the given value after each window.
    fn learnt_by(
        windows: usize,
        parameter: Parameter,
        error: impl Fn(usize) -> f64,
        taken_for: impl Fn(usize) -> f64,
        surprise_of_each: f64,
    ) -> LongRunVariance {
        let mut variance = LongRunVariance::default();
        let mut jacobian = ByParameters::zeros();
        jacobian[(0, parameter.index())] = 1.0;
        for i in 0..windows {
            let window = window(i as i64, &jacobian, error(i));
            let mut values = Values::zeros();
            values[parameter.index()] = taken_for(i);
            let expected = Expectation {
                scale: 1.0,
                surprise: surprise_of_each,
            };
            variance.push_expected(&window, &values, expected);
        }
        variance
    }

    /// A window of unit variance whose motion errs along the track, by parameters that are all zero.
    pub fn window(number: i64, jacobian: &ByParameters, error: f64) -> Window {
        let (residual, covariance) = (Vector3::new(error, 0.0, 0.0), Matrix3::identity());
        let innovation = Innovation {
            residual,
            jacobian: *jacobian,
            covariance,
        };
        Window {
            begin: RobotTime(number),
            end: RobotTime(number + 1),
            residual,
            jacobian: *jacobian,
            covariance,
            carry: Matrix3::identity(),
            motion_covariance: covariance,
            end_covariance: Matrix3::zeros(),
            values: Values::zeros(),
            track: Track::default(),
            innovation,
            evidence: Evidence::of_window(&innovation).unwrap(),
        }
    }

    #[test]
    fn changes_are_judged_from_the_fifth_block_on_and_with_caution_up_to_the_tenth() {
        let of_blocks = |blocks| learnt_from(blocks * BLOCK, Parameter::LidarX, |_| 0.0);
        assert!(!of_blocks(4).is_known() && of_blocks(5).is_known());
        let is_cautious = [5, 10, 11].map(|blocks| of_blocks(blocks).caution() > 1.0);
        assert_eq!(is_cautious, [true, true, false]);
    }

    #[test]
    fn a_window_surprises_by_what_the_filter_did_not_expect_of_it() {
        let vehicle = Vehicle::new(VehicleModel::Bicycle, 1.2);
        let settings = EstimatorSettings::default();
        let mut prior = Prior::cold(&vehicle, None, &settings);
        let y = Parameter::LidarY.index();
        prior.values = Values::zeros();
        prior.values[y] = 2.0;
        prior.covariance.fill(0.0);
        prior.covariance[(y, y)] = 3.0;
        let before = Filter::new(vehicle, &settings, &prior);
        let mut jacobian = ByParameters::zeros();
        jacobian[(0, y)] = 1.0;
        let surprise_of = |error: f64| surprise(&window(0, &jacobian, error), &before).unwrap();
        // By zero the window errs by 6, so by 2 of y it errs by 4, of a variance of 1 and the filter's 3.
        assert!((surprise_of(6.0) - 4.0).abs() < 1e-12);
        assert!(surprise_of(2.0) < 1e-12);
        assert!((surprise_of(1e6) - SQUARE_MAX).abs() < 1e-12);
    }

    /// A filter that begins far off gets to the truth within its first block, which it then fits.
    /// One that did not expect to be far off was surer of itself than it may be.
    #[test]
    fn a_block_is_held_against_what_is_known_at_its_end_unless_its_windows_surprised() {
        let scatter_of = |surprise: f64| {
            let found = learnt_by(
                5 * BLOCK,
                Parameter::LidarY,
                |_| 0.0,
                |window| 100.0 / (1.0 + (window + 1) as f64).powi(4),
                surprise,
            );
            let ratios = *found.scatter(&ParameterCovariance::identity()).ratios();
            ratios[Parameter::LidarY.index()]
        };
        assert!(scatter_of(4.0) < 1.05, "{}", scatter_of(4.0));
        assert!(scatter_of(20.0) > 2.0, "{}", scatter_of(20.0));
    }

    #[test]
    fn errors_that_alternate_do_not_add_up_and_those_that_last_do() {
        assert!(ratio(|i| if i % 2 == 0 { 1.0 } else { -1.0 }) < 1.05);
        assert!((ratio(|_| 1.0) - BLOCK as f64).abs() < 0.5);
    }

    #[test]
    fn a_speed_scale_is_published_with_the_slip_that_outlasts_blocks() {
        let published_over_claimed = |error: &dyn Fn(usize) -> f64| {
            let variance = learnt(Parameter::SpeedScale, error);
            let covariance = ParameterCovariance::identity();
            let published = publish(&variance.scatter(&covariance)).diagonal();
            let wider = published.component_div(&variance.scatter(&covariance).claim().diagonal());
            // What many blocks leave to Student is the same for all.
            wider[Parameter::SpeedScale.index()] / wider[Parameter::LidarX.index()]
        };
        assert!(published_over_claimed(&|i| if i % 2 == 0 { 1.0 } else { -1.0 }) < 1.05);
        let lasts = published_over_claimed(&|i| if i / 12 % 2 == 0 { 1.0 } else { -1.0 });
        assert!(lasts > 1.2, "{lasts}");
    }

    #[test]
    fn what_scatters_is_published_by_how_many_blocks_say_so() {
        let published_over_claimed = |windows: usize, error: f64| {
            let variance = learnt_from(windows, Parameter::LidarYaw, |_| error);
            let covariance = ParameterCovariance::identity();
            let i = Parameter::LidarYaw.index();
            publish(&variance.scatter(&covariance))[(i, i)]
                / variance.scatter(&covariance).claim()[(i, i)]
        };
        let four_blocks = published_over_claimed(4 * BLOCK, 1.0);
        assert!((2.5..3.0).contains(&four_blocks), "{four_blocks}");
        assert!(published_over_claimed(2000, 1.0) < 1.2);
        assert!((published_over_claimed(4 * BLOCK, 0.1) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn one_wild_block_of_many_is_no_scatter_of_the_mount_and_two_are() {
        let jumps_at = |jumps: &'static [usize]| {
            move |i: usize| {
                if jumps.contains(&i) { 20.0 } else { 0.0 }
            }
        };
        let scatter_of = |parameter: Parameter, blocks: usize, jumps: &'static [usize]| {
            let variance = learnt_from(blocks * BLOCK, parameter, jumps_at(jumps));
            let covariance = ParameterCovariance::identity();
            let scatter = variance.scatter(&covariance);
            let i = parameter.index();
            (scatter.alarm_ratios(40.0)[i], scatter.claim()[(i, i)])
        };
        let x = Parameter::LidarX;
        let (alarm, claim) = scatter_of(x, 20, &[155]);
        assert!(alarm < 1.05 && claim > 2.0, "{alarm}, {claim}");
        assert!(scatter_of(x, 20, &[125, 155]).0 > 3.0);
        assert!(scatter_of(Parameter::SteeringOffset, 20, &[155]).0 > 2.0);
        // Of few blocks, one tells too much of a robot that does not obey its model.
        assert!(scatter_of(x, 9, &[55]).0 > 3.0);
        // One of long ago does not make another one count.
        assert!(scatter_of(x, 90, &[155, 855]).0 < 2.5);
    }

    #[test]
    fn one_window_accuses_no_mount_whose_lone_wild_block_does_not_count() {
        let jump = |i: usize| if i == 155 { 20.0 } else { 0.0 };
        let variance = learnt_from(20 * BLOCK, Parameter::SpeedScale, jump);
        let covariance = ParameterCovariance::identity();
        let scatter = variance.scatter(&covariance);
        let thresholds = Thresholds::for_false_alarm_hours(1000.0);
        let raised = thresholds.raised(&scatter.alarm_ratios(thresholds.least()));
        let mount = 1;
        assert!(raised.window_chi2_max() > raised.values()[mount]);
        let limited = thresholds.limit_window(raised, scatter.window_ratio_max());
        assert!(limited.window_chi2_max() < limited.values()[mount]);
    }

    #[test]
    fn nothing_is_claimed_before_data_have_repeated_it() {
        let claim = LongRunVariance::default()
            .scatter(&ParameterCovariance::identity())
            .claim();
        assert!((claim[(0, 0)] - UNPROVEN_RATIO).abs() < 1e-9);
    }
}
