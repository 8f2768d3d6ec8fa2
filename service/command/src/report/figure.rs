//! The figures of a report, as SVG: each parameter over time, the filter's consistency, the path.

use std::error::Error;
use std::ops::Range;

use fleetcal_model::{Parameter, ParameterStatus, Unit};
use fleetcal_proto::estimate::{CalibrationReport, EstimateDocument};
use plotters::prelude::*;

use crate::CommandError;
use crate::session_record::SessionRecord;
use crate::table::title;

/// Width of every figure, pixels: about that of a phone, so that no screen shrinks its labels much.
const WIDTH: u32 = 440;
/// Width and height of a figure, pixels.
const SIZE: (u32, u32) = (WIDTH, 250);
/// Size of the path's figure, which shows both axes to the same scale, pixels.
const PATH_SIZE: (u32, u32) = (WIDTH, WIDTH);
/// Height of the letters, pixels.
const LETTERS: u32 = 15;
/// Font requested from the drawing library, which requires a whole size and divides it by 1.24.
const LABEL: (&str, f64) = ("sans-serif", 19.0);
/// Least width at which a page may show a figure, pixels: its letters are then 12 pixels high.
pub const WIDTH_MIN: u32 = WIDTH * 12 / LETTERS;
/// Most labels of an axis that do not touch each other.
const LABELS_MAX: usize = 5;
/// Colour that a colour-blind reader can tell from the others (Okabe and Ito).
const BLUE_LINE: RGBColor = RGBColor(0, 114, 178);
const ORANGE_LINE: RGBColor = RGBColor(213, 94, 0);
/// Most points of a curve: more than the figure's pixels are useless.
const POINTS_MAX: usize = 2_000;

type Points = Vec<(f64, f64)>;

/// One pair of axes with a curve, its uncertainty and marks at certain times.
struct Chart<'a> {
    x: Range<f64>,
    y: Range<f64>,
    x_name: &'a str,
    y_name: &'a str,
    curve: Points,
    band: Option<[Points; 2]>,
    marks: &'a [f64],
}

/// Draws all figures, each with its caption.
///
/// # Errors
/// The drawing library fails.
pub fn figures(
    report: &CalibrationReport,
    session: &SessionRecord,
) -> Result<Vec<(&'static str, String)>, CommandError> {
    let marks: Vec<f64> = report.events.iter().map(|event| event.onset_s).collect();
    let mut figures = Vec::new();
    for (name, last) in report.parameters.iter() {
        let is_found = !matches!(last.status, ParameterStatus::Off | ParameterStatus::Fixed);
        if is_found && let Some(chart) = parameter(name, &session.estimates, &marks) {
            figures.push((title(name), drawn(SIZE, &chart)?));
        }
    }
    if let Some(chart) = consistency(&session.estimates, &marks) {
        let caption =
            "Consistency: normalised innovation squared over what is expected; 1 is right";
        figures.push((caption, drawn(SIZE, &chart)?));
    }
    if let Some(chart) = path(session) {
        let caption = "Where the rear axle drove, in the odometry frame";
        figures.push((caption, drawn(PATH_SIZE, &chart)?));
    }
    Ok(figures)
}

/// Makes the chart of a parameter's value with two sigmas either way. Values from before the
/// uncertainty fell to a tenth of its initial value are cut off at the edges of the figure.
fn parameter<'a>(
    name: Parameter,
    estimates: &[EstimateDocument],
    marks: &'a [f64],
) -> Option<Chart<'a>> {
    let (scale, y_name) = match name.unit() {
        Unit::Radian => (180.0 / std::f64::consts::PI, "degrees"),
        Unit::Metre => (1e3, "mm"),
        Unit::Second => (1e3, "ms"),
        Unit::One => (1.0, "ratio"),
    };
    let at = |estimate: &EstimateDocument, sigmas: f64| {
        let parameter = estimate.parameters.get(name);
        let value = parameter.value + sigmas * parameter.sigma;
        (estimate.time_s, scale * value)
    };
    let curve = |sigmas: f64| -> Points {
        thinned(estimates)
            .map(|estimate| at(estimate, sigmas))
            .collect()
    };
    // The second half of the recording fills the figure.
    let settled = estimates.get(estimates.len() / 2..)?;
    let shown = settled
        .iter()
        .flat_map(|estimate| [at(estimate, -3.0), at(estimate, 3.0)]);
    let (x, y) = (
        extent(curve(0.0).into_iter().map(|point| point.0))?,
        extent(shown.map(|point| point.1))?,
    );
    Some(Chart {
        x,
        y,
        x_name: "s",
        y_name,
        curve: curve(0.0),
        band: Some([curve(-2.0), curve(2.0)]),
        marks,
    })
}

fn consistency<'a>(estimates: &[EstimateDocument], marks: &'a [f64]) -> Option<Chart<'a>> {
    let curve: Points = thinned(estimates)
        .filter(|estimate| estimate.consistency.nis_dof > 0.0)
        .map(|estimate| {
            let consistency = &estimate.consistency;
            (estimate.time_s, consistency.nis_mean / consistency.nis_dof)
        })
        .collect();
    let ratios = curve.iter().map(|point| point.1).chain([0.0, 2.0]);
    Some(Chart {
        x: extent(curve.iter().map(|point| point.0))?,
        y: extent(ratios)?,
        x_name: "s",
        y_name: "NIS / expected",
        curve,
        band: None,
        marks,
    })
}

fn path(session: &SessionRecord) -> Option<Chart<'static>> {
    let curve: Points = thinned(&session.path)
        .map(|(_, pose)| (pose.x_m, pose.y_m))
        .collect();
    let x = extent(curve.iter().map(|point| point.0))?;
    let y = extent(curve.iter().map(|point| point.1))?;
    let half = 0.5 * (x.end - x.start).max(y.end - y.start);
    let around = |range: Range<f64>| {
        let middle = 0.5 * (range.start + range.end);
        middle - half..middle + half
    };
    Some(Chart {
        x: around(x),
        y: around(y),
        x_name: "x, m",
        y_name: "y, m",
        curve,
        band: None,
        marks: &[],
    })
}

/// Thins the points evenly to at most [`POINTS_MAX`].
fn thinned<T>(points: &[T]) -> impl Iterator<Item = &T> {
    points
        .iter()
        .step_by(points.len().div_ceil(POINTS_MAX).max(1))
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

fn drawn(size: (u32, u32), chart: &Chart) -> Result<String, CommandError> {
    let mut svg = String::new();
    draw(&mut svg, size, chart).map_err(|error| CommandError::Figure(error.to_string()))?;
    Ok(svg)
}

fn draw(svg: &mut String, size: (u32, u32), shown: &Chart) -> Result<(), Box<dyn Error>> {
    let root = SVGBackend::with_string(svg, size).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .margin(8)
        .x_label_area_size(46)
        .y_label_area_size(64)
        .build_cartesian_2d(shown.x.clone(), shown.y.clone())?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .x_labels(LABELS_MAX)
        .y_labels(LABELS_MAX)
        .label_style(LABEL)
        .axis_desc_style(LABEL)
        .x_desc(shown.x_name)
        .y_desc(shown.y_name)
        .draw()?;
    let inside = |&(x, y): &(f64, f64)| {
        (
            x.clamp(shown.x.start, shown.x.end),
            y.clamp(shown.y.start, shown.y.end),
        )
    };
    if let Some([lower, upper]) = &shown.band {
        let ring: Points = lower.iter().chain(upper.iter().rev()).map(inside).collect();
        let area = Polygon::new(ring, BLUE_LINE.mix(0.2).filled());
        chart.draw_series(std::iter::once(area))?;
    }
    for &mark in shown.marks {
        let line = [(mark, shown.y.start), (mark, shown.y.end)];
        chart.draw_series(LineSeries::new(line, ORANGE_LINE.stroke_width(1)))?;
    }
    let curve = shown.curve.iter().map(inside);
    chart.draw_series(LineSeries::new(curve, BLUE_LINE.stroke_width(2)))?;
    root.present()?;
    Ok(())
}
