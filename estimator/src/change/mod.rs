//! Change detection: is this still the vehicle that was calibrated, and if not, what moved and
//! when?
//!
//! Windows of 0.4 m are compared with the filter's knowledge *before* them; the filter itself is no
//! reference, because it absorbs a change within seconds.

pub mod block;
pub mod detection;
pub mod evidence;
pub mod fault;
pub mod long_run;
pub mod mean_pose;
pub mod search;
pub mod step;
pub mod window;

use std::collections::VecDeque;

use crate::drive_history::DriveHistory;
use crate::estimate::{Cause, ChangeKind, Parameter};
use crate::filter::follow::Follower;
use crate::filter::relevance::Known;
use crate::filter::{Filter, OdometryReading, ParameterCovariance, Values};
use crate::settings::EstimatorSettings;
use crate::stream::RobotTime;
use crate::vehicle::Vehicle;
use detection::{DetectionState, Prospect, Visibility, known_causes};
use evidence::{CAUSES, HYPOTHESES, Thresholds};
use fault::{Fault, FaultWatch};
use long_run::LongRunVariance;
use mean_pose::Way;
use search::{
    Accusation, Candidate, ONSET_WINDOWS, Reference, Search, candidates, expected_evidence, misfit,
    strongest,
};
use step::suspected;
use window::{Window, WindowCutter, WindowEnd};

/// Windows that are looked back over: some 25 m.
pub const WINDOWS_MAX: usize = 60;
/// Fewest windows before anything is judged.
const WINDOWS_MIN: usize = 8;
/// Windows after which the visibility of changes is checked again.
const SEE_EVERY: usize = 5;
/// Windows that the long-run variance is behind: a change is flagged before it counts as noise.
const SETTLED_WINDOWS: usize = 25;
/// Windows that it is behind while a change is suspected, which a robot that has just set off takes
/// longer to show: it counted as noise before it was flagged.
const SUSPECTED_WINDOWS: usize = 45;
/// Misfit below which a cause explains the evidence.
const MISFIT_MAX: f64 = 3.0;
/// Windows without a cause that explains it after which the change is called unknown.
const UNEXPLAINED_WINDOWS: usize = 15;

/// A window with the filter as it was at its beginning.
#[derive(Debug, Clone)]
struct Remembered {
    window: Window,
    filter: Filter,
}

/// Bar that a change has to exceed.
#[derive(Debug, Clone, Copy)]
struct Bar<'a> {
    reference: &'a Reference,
    /// Scale of the noise (as a variance, over the configured one).
    noise_scale: f64,
    thresholds: &'a Thresholds,
}

/// A change that was detected.
#[derive(Debug, Clone)]
pub struct Detected {
    /// A change of the vehicle, or a fault.
    pub kind: ChangeKind,
    /// Cause that moved or failed.
    pub cause: Cause,
    /// The parameters to open again.
    pub parameters: Vec<Parameter>,
    /// Stretch of LiDAR time in which it happened.
    pub onset: (RobotTime, RobotTime),
    /// The filter as it was before.
    pub filter_before: Filter,
}

/// Watches one robot for changes.
#[derive(Debug, Clone, Default)]
pub struct ChangeWatch {
    cutter: WindowCutter<Filter>,
    remembered: VecDeque<Remembered>,
    long_run: LongRunVariance,
    faults: FaultWatch,
    /// The newest windows, whose common error is not learnt yet.
    unlearnt: usize,
    /// True if there is evidence enough for a change, but for the caution that few blocks require
    /// or a cause.
    is_suspected: bool,
    visibility: Visibility,
    /// The first window before which the parameters of every cause were known.
    known_from: Option<usize>,
    /// Windows since the visibility of changes was checked.
    since_seen: usize,
    /// Squares of the steps that the newest windows suggest beyond chance.
    suspicion: Values,
}

impl ChangeWatch {
    /// Forgets the windows: the next do not compare with them.
    pub fn restart(&mut self) {
        *self = Self::with_long_run(self.long_run.clone());
    }

    /// Begins with the known scatter of windows.
    pub fn with_long_run(mut long_run: LongRunVariance) -> Self {
        long_run.break_block();
        Self {
            long_run,
            ..Self::default()
        }
    }

    /// Long-run variance of the windows: the factor of every variance.
    pub fn long_run(&self) -> &LongRunVariance {
        &self.long_run
    }

    /// Begins a new window without forgetting: the LiDAR poses before do not compare.
    pub fn break_window(&mut self) {
        let ended = self.cutter.restart();
        self.remember(ended);
    }

    /// Adds the reading that the filter has just followed; returns a change once it is certain.
    pub fn watch(
        &mut self,
        reading: &OdometryReading,
        drive: &DriveHistory,
        vehicle: &Vehicle,
        follower: &Follower,
        settings: &EstimatorSettings,
    ) -> Option<Detected> {
        let filter = &follower.filter;
        let way = Way {
            drive,
            vehicle,
            values: filter.values(),
            noise: filter.motion_noise(),
            noise_scale: filter.noise_scale(),
        };
        let cut = self.cutter.push(reading, way, || filter.clone());
        let is_complete = cut.complete.is_some() || cut.complete_at_end.is_some();
        self.remember(cut.complete);
        if let Some(end) = cut.end {
            let fault = self.faults.push(&end.track, filter.noise_scale());
            if self.has_fault() {
                self.cutter.leave_out_ended();
                return fault.map(|(fault, lasted)| self.failed(fault, lasted, &end, filter));
            }
        }
        self.remember(cut.complete_at_end);
        if !is_complete {
            return None;
        }
        let known = self.long_run.known(filter);
        self.learn(filter.values());
        let claimed = self.long_run.scatter(&known.covariance).claim();
        self.visibility.know(&claimed, settings);
        self.suspicion = Values::zeros();
        let detected = self.judge(settings);
        if detected.is_some() {
            self.suspicion = Values::zeros();
        }
        detected
    }

    fn remember(&mut self, complete: Option<(Window, Filter)>) {
        let Some((window, filter)) = complete else {
            return;
        };
        self.remembered.push_back(Remembered { window, filter });
        if self.remembered.len() > WINDOWS_MAX {
            self.remembered.pop_front();
            self.known_from = self.known_from.map(|from| from.saturating_sub(1));
        }
        self.unlearnt += 1;
    }

    /// State of detection for each cause.
    pub fn detection(&self) -> [DetectionState; CAUSES] {
        if self.has_fault() {
            [DetectionState::Fault; CAUSES]
        } else {
            self.visibility.states()
        }
    }

    /// True if a change of this parameter would go unseen for more than a few metres. A fault shows
    /// nothing, so that it withholds nothing more and believes nothing more.
    pub fn is_blind(&self, parameter: Parameter) -> bool {
        self.visibility.is_blind(parameter)
    }

    /// Squares of the steps of each parameter that the newest windows suggest beyond chance, and that
    /// are not certain enough to be flagged.
    pub fn suspicion(&self) -> &Values {
        &self.suspicion
    }

    /// True during a fault: nothing may be learnt.
    pub fn has_fault(&self) -> bool {
        self.faults.active().is_some()
    }

    /// Forgets the last windows, in which a fault was going on, and sets the filter back to before
    /// it.
    fn failed(&mut self, fault: Fault, lasted: usize, last: &WindowEnd, now: &Filter) -> Detected {
        // The last window is not remembered yet; the one before the first may be touched too.
        let (begin, filter_before) = match self.forget(lasted) {
            Some(first) => (first.window.begin, first.filter),
            None => (last.lasts.0, now.clone()),
        };
        Detected {
            kind: ChangeKind::Fault,
            cause: fault.cause(),
            parameters: Vec::new(),
            onset: (begin, last.lasts.1),
            filter_before,
        }
    }

    /// Forgets the last windows, so many, and returns the first of them. What was learnt of those before
    /// stays learnt, and is not learnt once more.
    fn forget(&mut self, lasted: usize) -> Option<Remembered> {
        let forgotten = lasted.min(self.remembered.len());
        let kept = self.remembered.len() - forgotten;
        let first = self.remembered.drain(kept..).next();
        self.suspicion = Values::zeros();
        self.known_from = self.known_from.filter(|from| *from < kept);
        self.unlearnt = self.unlearnt.saturating_sub(forgotten);
        self.long_run.break_block();
        first
    }

    /// Learns the common error of settled windows. While the filter still learns, nothing can count
    /// as a change and all are settled.
    fn learn(&mut self, now: &Values) {
        let is_known = self.long_run.has_shown_scatter() || self.visibility.knows_any();
        let may_be_judged = self.long_run.is_known() && is_known;
        let unsettled = match (may_be_judged, self.is_suspected) {
            (false, _) => 0,
            (true, false) => SETTLED_WINDOWS,
            (true, true) => SUSPECTED_WINDOWS,
        };
        while self.unlearnt > unsettled {
            let next = self.remembered.len().checked_sub(self.unlearnt);
            self.unlearnt -= 1;
            if let Some(Remembered { window, filter }) = next.and_then(|i| self.remembered.get(i)) {
                self.long_run.push(window, now, filter);
            }
        }
    }

    /// The first window whose filter knew enough before it to be a reference: for every cause where
    /// that leaves windows enough, else for one at least. Once the scatter is known every filter is a
    /// reference: its covariance says how much it knew.
    fn reference_window(&mut self, settings: &EstimatorSettings) -> usize {
        if self.long_run.has_shown_scatter() {
            return 0;
        }
        if let Some(from) = self.known_from {
            return from;
        }
        let knows = |remembered: &Remembered| {
            let covariance = self.long_run.known(&remembered.filter).covariance;
            known_causes(&self.long_run.scatter(&covariance).claim(), settings)
        };
        let windows = &self.remembered;
        let all = windows.partition_point(|window| knows(window).contains(&false));
        if all + WINDOWS_MIN <= windows.len() {
            self.known_from = Some(all);
            return all;
        }
        windows.partition_point(|window| !knows(window).contains(&true))
    }

    /// The causes that are judged: those whose parameters are known, and all once the scatter is known.
    fn judged_causes(
        &self,
        covariance: &ParameterCovariance,
        settings: &EstimatorSettings,
    ) -> [bool; CAUSES] {
        if self.long_run.has_shown_scatter() {
            [true; CAUSES]
        } else {
            known_causes(covariance, settings)
        }
    }

    /// The steps that the windows suggest. A wild window says little of whether there is one, but all of
    /// how large it is.
    fn suspect(
        &self,
        begin: usize,
        reference: &Reference,
        search: Search,
        found: &[Candidate],
    ) -> Values {
        let unlimited = Search {
            window_chi2_max: f64::INFINITY,
            ..search
        };
        let windows = self.remembered.range(begin..).map(|r| &r.window);
        suspected(windows, reference, &unlimited, found)
    }

    /// Checks now and then whether changes would be seen, and whether they would be by the same
    /// motion of a robot that does not scatter.
    fn see(&mut self, begin: usize, of_this_robot: &Bar, known: &Known, thresholds: &Thresholds) {
        self.since_seen += 1;
        if self.since_seen < SEE_EVERY || !self.long_run.is_well_known() {
            return;
        }
        self.since_seen = 0;
        let Some(reference) = Reference::new(known.values, &known.covariance) else {
            return;
        };
        let without_scatter = &Bar {
            reference: &reference,
            noise_scale: 1.0,
            thresholds,
        };
        let windows = || self.remembered.range(begin..).map(|r| &r.window);
        let [of_this_robot, without_scatter] =
            [of_this_robot, without_scatter].map(|bar| Prospect {
                expected: expected_evidence(windows(), bar.reference, bar.noise_scale),
                required: *bar.thresholds.values(),
            });
        let count = windows().len();
        self.visibility.see(count, &of_this_robot, &without_scatter);
    }

    fn judge(&mut self, settings: &EstimatorSettings) -> Option<Detected> {
        if !self.long_run.is_known() {
            return None;
        }
        let begin = self.reference_window(settings);
        if self.remembered.len() < begin + WINDOWS_MIN {
            return None;
        }
        let oldest = &self.remembered.get(begin)?.filter;
        let known_before = self.long_run.known(oldest);
        let scatter = self.long_run.scatter(&known_before.covariance);
        let judged = self.judged_causes(&scatter.claim(), settings);
        // The scatter raises the thresholds, and is not in the reference as well.
        let reference = Reference::new(known_before.values, &known_before.covariance)?;
        let without_scatter = Thresholds::for_false_alarm_hours(settings.false_alarm_hours);
        let raised = without_scatter.raised(&scatter.alarm_ratios(without_scatter.least()));
        let usual = without_scatter.limit_window(raised, scatter.window_ratio_max());
        // The limit of a single window grows with the thresholds, as it does with scatter.
        let thresholds = usual.raised(&Values::repeat(self.long_run.caution()));
        let noise_scale = oldest.noise_scale();
        let of_this_robot = Bar {
            reference: &reference,
            noise_scale,
            // Without the caution, which ends after some metres.
            thresholds: &usual,
        };
        self.see(begin, &of_this_robot, &known_before, &without_scatter);
        let windows = || self.remembered.range(begin..).map(|r| &r.window);
        let mut search = Search {
            noise_scale,
            window_chi2_max: thresholds.window_chi2_max(),
            every_onset: false,
        };
        // 1. Has anything happened? No single wild window may say so.
        let limited = candidates(windows(), &reference, &search);
        self.suspicion = self.suspect(begin, &reference, search, &limited);
        let alarm = strongest(&limited, &thresholds)?;
        let evidence = alarm.margin + thresholds.values()[alarm.hypothesis];
        self.is_suspected = evidence > usual.values()[alarm.hypothesis];
        if alarm.margin < 0.0 || !judged[alarm.hypothesis] {
            return None;
        }
        let waited = self.remembered.len() - 1 - begin - alarm.onset;
        if self
            .faults
            .may_be_stuck(waited.saturating_sub(ONSET_WINDOWS))
        {
            return None;
        }
        // 2. What, and when?
        search.window_chi2_max = f64::INFINITY;
        search.every_onset = true;
        let every = candidates(windows(), &reference, &search);
        let accusation = strongest(&every, &thresholds)?;
        let explained = accusation.margin > 0.0
            && misfit(windows(), &reference, &search, &accusation)
                .is_some_and(|misfit| misfit < MISFIT_MAX);
        if explained && judged[accusation.hypothesis] {
            return self.detected(begin, &accusation, false);
        }
        // Without a cause it takes twice the evidence: a model that does not quite fit is no change.
        let is_significant = alarm.margin > thresholds.values()[alarm.hypothesis];
        if waited >= UNEXPLAINED_WINDOWS && is_significant {
            self.detected(begin, &alarm, true)
        } else {
            None
        }
    }

    fn detected(&self, begin: usize, accusation: &Accusation, unknown: bool) -> Option<Detected> {
        let onset = begin + accusation.onset;
        let at = self.remembered.get(onset)?;
        let before = self.remembered.get(onset.saturating_sub(1))?;
        // The onset is known to a window or so: the one behind it is left out as well.
        let last = self.remembered.get(onset + ONSET_WINDOWS)?;
        let hypothesis = HYPOTHESES.get(accusation.hypothesis)?;
        let (cause, parameters) = if unknown {
            let all = HYPOTHESES
                .iter()
                .flat_map(|h| h.parameters.iter().copied())
                .collect();
            (Cause::Unknown, all)
        } else {
            (hypothesis.cause, hypothesis.parameters.to_vec())
        };
        Some(Detected {
            kind: ChangeKind::CalibrationChanged,
            cause,
            parameters,
            onset: (at.window.begin, last.window.end),
            filter_before: before.filter.clone(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::long_run::tests::window;
    use super::*;
    use crate::filter::constraint::ByParameters;
    use crate::filter::prior::Prior;
    use crate::vehicle::VehicleModel;
    use window::Track;

    #[test]
    fn windows_before_a_fault_are_learnt_once() {
        let vehicle = Vehicle::new(VehicleModel::Bicycle, 1.2);
        let settings = EstimatorSettings::default();
        let prior = Prior::cold(&vehicle, None, &settings);
        let filter = Filter::new(vehicle, &settings, &prior);
        let mut watch = ChangeWatch::default();
        for number in 0..40 {
            let window = window(number, &ByParameters::zeros(), 0.0);
            watch.remember(Some((window, filter.clone())));
        }
        watch.unlearnt = 25;
        let first = watch.forget(4).unwrap();
        assert_eq!(first.window.begin, RobotTime(36));
        assert_eq!((watch.remembered.len(), watch.unlearnt), (36, 21));
        watch.forget(30);
        assert_eq!((watch.remembered.len(), watch.unlearnt), (6, 0));
    }

    #[test]
    fn a_fault_makes_no_value_known() {
        let mut watch = ChangeWatch::default();
        let unknown = ParameterCovariance::identity();
        watch
            .visibility
            .know(&unknown, &EstimatorSettings::default());
        let towed = Track {
            moved_m: 1.0,
            duration_s: 1.0,
            ..Track::default()
        };
        for _ in 0..2 {
            watch.faults.push(&towed, 1.0);
        }
        assert!(watch.has_fault() && watch.is_blind(Parameter::LidarYaw));
    }
}
