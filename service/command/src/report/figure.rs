//! The figures of a report: each parameter over time, the filter's consistency, the path. Each has
//! the numbers behind it.

use std::f64::consts::PI;
use std::ops::Range;

use fleetcal_model::{Innovation, Parameter, ParameterStatus, Unit};
use fleetcal_proto::estimate::{CalibrationReport, EstimateDocument};

use super::draw::{Chart, Points, Scale, svg};
use crate::CommandError;
use crate::session_record::SessionRecord;
use crate::table::title;

/// Most points of a curve: more than the figure's pixels are useless.
const POINTS_MAX: usize = 2_000;
/// Most rows of the table behind a figure.
const ROWS_MAX: usize = 100;
/// Half width of a band, in sigmas.
const BAND_SIGMAS: f64 = 2.0;
/// Axes of an innovation: name, unit of the figure, and its size in SI.
const AXES: [(&str, &str, f64); 3] = [
    ("Innovation forwards", "mm", 1e3),
    ("Innovation to the left", "mm", 1e3),
    ("Innovation in yaw", "degrees", 180.0 / PI),
];

/// Figure with its name, and the table of its numbers.
pub(super) struct Figure {
    pub name: String,
    /// Meaning of the shaded band; empty without one.
    pub band: &'static str,
    pub svg: String,
    pub head: Vec<String>,
    /// Time, and the numbers of each column.
    pub rows: Vec<Vec<f64>>,
}

/// Draws the figures of the parameters that the recording tells.
///
/// # Errors
/// The drawing library fails.
pub(super) fn parameters(
    report: &CalibrationReport,
    session: &SessionRecord,
) -> Result<Vec<Figure>, CommandError> {
    let marks = marks(report);
    let mut figures = Vec::new();
    for (name, last) in report.parameters.iter() {
        let is_found = !matches!(last.status, ParameterStatus::Off | ParameterStatus::Fixed);
        if is_found && let Some(figure) = parameter(name, &session.estimates, &marks)? {
            figures.push(figure);
        }
    }
    Ok(figures)
}

/// Draws NIS and the innovations over time.
///
/// # Errors
/// The drawing library fails.
pub(super) fn consistency(
    report: &CalibrationReport,
    session: &SessionRecord,
) -> Result<Vec<Figure>, CommandError> {
    let marks = marks(report);
    let mut figures: Vec<Figure> = nis(&session.estimates, &marks)?.into_iter().collect();
    for (axis, &of_axis) in AXES.iter().enumerate() {
        figures.extend(innovation(axis, of_axis, &session.estimates, &marks)?);
    }
    Ok(figures)
}

/// Draws the path.
///
/// # Errors
/// The drawing library fails.
pub(super) fn path(session: &SessionRecord) -> Result<Option<Figure>, CommandError> {
    let curve: Points = thinned(&session.path, POINTS_MAX)
        .map(|(_, pose)| (pose.x_m, pose.y_m))
        .collect();
    let (Some(x), Some(y)) = (
        extent(curve.iter().map(|point| point.0)),
        extent(curve.iter().map(|point| point.1)),
    ) else {
        return Ok(None);
    };
    let half = 0.5 * (x.end - x.start).max(y.end - y.start);
    let around = |range: Range<f64>| {
        let middle = 0.5 * (range.start + range.end);
        middle - half..middle + half
    };
    let rows = thinned(&curve, ROWS_MAX)
        .map(|&(x, y)| vec![x, y])
        .collect();
    let chart = Chart {
        x: around(x),
        y: around(y),
        x_name: "x, m",
        y_name: "y, m",
        scale: Scale::Square,
        curves: vec![curve],
        dots: Points::new(),
        bands: Vec::new(),
        level: None,
        marks: &[],
    };
    Ok(Some(Figure {
        name: "Path of the rear axle in the odometry frame".to_owned(),
        band: "",
        svg: svg(&chart)?,
        head: ["x (m)", "y (m)"].map(str::to_owned).to_vec(),
        rows,
    }))
}

/// Times of the events, in their order in the report.
fn marks(report: &CalibrationReport) -> Vec<f64> {
    report.events.iter().map(|event| event.onset_s).collect()
}

/// Draws a parameter's value with two sigmas either way, where it is known. Values from before the
/// second half of the recording are cut off at the edges of the figure.
fn parameter(
    name: Parameter,
    estimates: &[EstimateDocument],
    marks: &[f64],
) -> Result<Option<Figure>, CommandError> {
    let (scale, unit) = match name.unit() {
        Unit::Radian => (180.0 / PI, "degrees"),
        Unit::Metre => (1e3, "mm"),
        Unit::Second => (1e3, "ms"),
        Unit::One => (1.0, "ratio"),
    };
    let at = |estimate: &EstimateDocument, sigmas: f64| {
        let parameter = estimate.parameters.get(name);
        let value = parameter.value + sigmas * parameter.sigma;
        (estimate.time_s, scale * value)
    };
    let is_known = |estimate: &&EstimateDocument| {
        estimate.parameters.get(name).status != ParameterStatus::Unobservable
    };
    let points: Vec<&EstimateDocument> = thinned(estimates, POINTS_MAX).collect();
    let stretches: Vec<&[&EstimateDocument]> = points
        .split(|estimate| !is_known(estimate))
        .filter(|stretch| !stretch.is_empty())
        .collect();
    let curve = |stretch: &[&EstimateDocument], sigmas: f64| -> Points {
        stretch
            .iter()
            .map(|estimate| at(estimate, sigmas))
            .collect()
    };
    let known: Vec<&EstimateDocument> = estimates.iter().filter(is_known).collect();
    let settled = known.get(known.len() / 2..).unwrap_or_default();
    let shown = settled
        .iter()
        .flat_map(|estimate| [at(estimate, -3.0), at(estimate, 3.0)]);
    let (Some(x), Some(y)) = (
        extent(estimates.iter().map(|estimate| estimate.time_s)),
        extent(shown.map(|point| point.1)),
    ) else {
        return Ok(None);
    };
    let rows = thinned(&known, ROWS_MAX).map(|estimate| {
        let parameter = estimate.parameters.get(name);
        vec![
            estimate.time_s,
            scale * parameter.value,
            scale * parameter.sigma,
        ]
    });
    let chart = Chart {
        x,
        y,
        x_name: "s",
        y_name: unit,
        scale: Scale::Linear,
        curves: stretches.iter().map(|one| curve(one, 0.0)).collect(),
        dots: Points::new(),
        bands: stretches
            .iter()
            .map(|one| [curve(one, -BAND_SIGMAS), curve(one, BAND_SIGMAS)])
            .collect(),
        level: None,
        marks,
    };
    Ok(Some(Figure {
        name: sentence_case(title(name)),
        band: "Shaded: ± 2 sigma.",
        svg: svg(&chart)?,
        head: vec![
            "s".to_owned(),
            format!("value ({unit})"),
            format!("sigma ({unit})"),
        ],
        rows: rows.collect(),
    }))
}

/// Draws the normalised innovation squared on a logarithmic scale, with its expectation and range.
fn nis(estimates: &[EstimateDocument], marks: &[f64]) -> Result<Option<Figure>, CommandError> {
    let judged: Vec<_> = thinned(estimates, POINTS_MAX)
        .filter(|estimate| estimate.consistency.nis_mean > 0.0)
        .filter_map(|estimate| {
            let consistency = &estimate.consistency;
            Some((estimate.time_s, consistency, consistency.nis_range?))
        })
        .collect();
    let of = |value: &dyn Fn(f64, [f64; 2]) -> f64| -> Points {
        judged
            .iter()
            .map(|(time_s, consistency, range)| (*time_s, value(consistency.nis_mean, *range)))
            .map(|(time_s, value)| (time_s, value.max(f64::MIN_POSITIVE).log10()))
            .collect()
    };
    let curve = of(&|nis, _| nis);
    let (lower, upper) = (of(&|_, range| range[0]), of(&|_, range| range[1]));
    let values = curve.iter().map(|point| point.1);
    let values = values.chain(late(&lower)).chain(late(&upper));
    let (Some(x), Some(y), Some((_, last, _))) = (
        extent(curve.iter().map(|point| point.0)),
        extent(values),
        judged.last(),
    ) else {
        return Ok(None);
    };
    let rows = thinned(&judged, ROWS_MAX)
        .map(|(time_s, consistency, [low, high])| vec![*time_s, consistency.nis_mean, *low, *high]);
    let chart = Chart {
        x,
        y,
        x_name: "s",
        y_name: "NIS",
        scale: Scale::Logarithm,
        level: (last.nis_dof > 0.0).then(|| last.nis_dof.log10()),
        curves: vec![curve],
        dots: Points::new(),
        bands: vec![[lower, upper]],
        marks,
    };
    Ok(Some(Figure {
        name: "NIS, the normalised innovation squared".to_owned(),
        band: "Shaded: 95 % of vehicles with the configured noise. Dashed: expected.",
        svg: svg(&chart)?,
        head: ["s", "NIS", "from", "to"].map(str::to_owned).to_vec(),
        rows: rows.collect(),
    }))
}

/// Draws one axis of the innovations with the sigmas that the configured noise implies.
fn innovation(
    axis: usize,
    (name, unit, scale): (&'static str, &'static str, f64),
    estimates: &[EstimateDocument],
    marks: &[f64],
) -> Result<Option<Figure>, CommandError> {
    let mut all: Vec<(f64, &Innovation)> = estimates
        .iter()
        .filter_map(|estimate| Some((estimate.time_s, estimate.consistency.innovation.as_ref()?)))
        .collect();
    // A robot at rest has no updates, and repeats the last one.
    all.dedup_by_key(|(_, innovation)| innovation.stamp_ns);
    let number = |of: &[f64; 3]| of.get(axis).map_or(0.0, |value| scale * value);
    let shown: Vec<(f64, f64, f64)> = thinned(&all, POINTS_MAX)
        .map(|(time_s, one)| (*time_s, number(&one.residual), number(&one.sigma)))
        .collect();
    let band = |sigmas: f64| -> Points {
        let edge = shown
            .iter()
            .map(|(time_s, _, sigma)| (*time_s, sigmas * sigma));
        edge.collect()
    };
    let dots: Points = shown
        .iter()
        .map(|(time_s, value, _)| (*time_s, *value))
        .collect();
    let (lower, upper) = (band(-BAND_SIGMAS), band(BAND_SIGMAS));
    let values = dots.iter().chain(&lower).chain(&upper).map(|point| point.1);
    let (Some(x), Some(y)) = (extent(dots.iter().map(|point| point.0)), extent(values)) else {
        return Ok(None);
    };
    let rows =
        thinned(&shown, ROWS_MAX).map(|(time_s, value, sigma)| vec![*time_s, *value, *sigma]);
    let chart = Chart {
        x,
        y,
        x_name: "s",
        y_name: unit,
        scale: Scale::Linear,
        curves: Vec::new(),
        bands: vec![[lower, upper]],
        dots,
        level: None,
        marks,
    };
    Ok(Some(Figure {
        name: name.to_owned(),
        band: "Shaded: ± 2 sigma with the configured noise.",
        svg: svg(&chart)?,
        head: vec![
            "s".to_owned(),
            format!("innovation ({unit})"),
            format!("sigma ({unit})"),
        ],
        rows: rows.collect(),
    }))
}

/// Writes a name as the begin of a sentence.
pub(super) fn sentence_case(name: &str) -> String {
    let mut letters = name.chars();
    let first = letters.next().map(|first| first.to_uppercase().to_string());
    first.unwrap_or_default() + letters.as_str()
}

/// Returns the values of the later points: the first means are of few updates, whose range is wide.
fn late(points: &[(f64, f64)]) -> impl Iterator<Item = f64> {
    points.iter().skip(points.len() / 4).map(|point| point.1)
}

/// Thins the items evenly to at most `most`.
fn thinned<T>(items: &[T], most: usize) -> impl Iterator<Item = &T> {
    items.iter().step_by(items.len().div_ceil(most).max(1))
}

/// Returns the range of the finite values with a margin; `None` without any.
fn extent(values: impl Iterator<Item = f64>) -> Option<Range<f64>> {
    let mut finite = values.filter(|value| value.is_finite());
    let first = finite.next()?;
    let (low, high) = finite.fold((first, first), |(low, high), value| {
        (low.min(value), high.max(value))
    });
    let air = (0.05 * (high - low)).max(1e-6);
    Some(low - air..high + air)
}
