//! Figures as SVG: panels in a grid, each with lines, bands and bars.

use std::error::Error;
use std::ops::Range;

use plotters::prelude::*;

use crate::error::EvaluationError;
use crate::report::Figure;

/// Width and height of one panel, pixels.
const PANEL: (u32, u32) = (300, 220);
/// Size of the captions and of the labels.
const CAPTION: (&str, i32) = ("sans-serif", 14);
const LABEL: (&str, i32) = ("sans-serif", 11);

/// Colour that a colour-blind reader can tell from the others (Okabe and Ito).
pub const BLUE_LINE: RGBColor = RGBColor(0, 114, 178);
/// Second such colour.
pub const ORANGE_LINE: RGBColor = RGBColor(213, 94, 0);
/// Third such colour.
pub const GREEN_LINE: RGBColor = RGBColor(0, 158, 115);
/// Colour of the background's curves.
pub const GREY_LINE: RGBColor = RGBColor(170, 170, 170);

/// Points of a curve.
pub type Points = Vec<(f64, f64)>;

/// Content of a panel.
#[derive(Debug, Clone)]
pub enum Series {
    /// A curve.
    Line(Points, RGBColor, u32),
    /// The area between a lower and an upper curve over the same x.
    Band(Points, Points, RGBColor),
    /// Bars between edges: left edge, right edge, height.
    Bars(Vec<(f64, f64, f64)>, RGBColor),
    /// Round marks.
    Marks(Points, RGBColor),
}

/// One pair of axes.
#[derive(Debug, Clone)]
pub struct Panel {
    /// Title above it.
    pub title: String,
    /// Name and unit of x.
    pub x_name: String,
    /// Name and unit of y.
    pub y_name: String,
    /// Shown part of x.
    pub x: Range<f64>,
    /// Shown part of y.
    pub y: Range<f64>,
    /// Its content, the last on top. Parts outside the axes are left out.
    pub series: Vec<Series>,
    /// Legend of colours, top right.
    pub legend: Vec<(&'static str, RGBColor)>,
}

/// Draws panels in rows of `columns`.
///
/// # Errors
/// When the drawing library fails.
pub fn figure(
    name: &'static str,
    caption: &str,
    columns: usize,
    panels: &[Panel],
) -> Result<Figure, EvaluationError> {
    let mut svg = String::new();
    draw(&mut svg, columns, panels).map_err(|error| EvaluationError::Figure {
        name: name.to_owned(),
        why: error.to_string(),
    })?;
    Ok(Figure {
        name,
        caption: caption.to_owned(),
        svg,
    })
}

fn draw(svg: &mut String, columns: usize, panels: &[Panel]) -> Result<(), Box<dyn Error>> {
    let rows = panels.len().div_ceil(columns);
    let size = (PANEL.0 * columns as u32, PANEL.1 * rows as u32);
    let root = SVGBackend::with_string(svg, size).into_drawing_area();
    root.fill(&WHITE)?;
    for (cell, panel) in root.split_evenly((rows, columns)).iter().zip(panels) {
        draw_panel(cell, panel)?;
    }
    root.present()?;
    Ok(())
}

type Cell<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;

fn draw_panel(cell: &Cell, panel: &Panel) -> Result<(), Box<dyn Error>> {
    let mut chart = ChartBuilder::on(cell)
        .caption(&panel.title, CAPTION)
        .margin(8)
        .x_label_area_size(32)
        .y_label_area_size(46)
        .build_cartesian_2d(panel.x.clone(), panel.y.clone())?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .x_labels(5)
        .y_labels(5)
        .x_label_formatter(&|x| number(*x))
        .y_label_formatter(&|y| number(*y))
        .label_style(LABEL)
        .axis_desc_style(LABEL)
        .x_desc(&panel.x_name)
        .y_desc(&panel.y_name)
        .draw()?;
    for series in &panel.series {
        match series {
            Series::Line(points, colour, width) => {
                for piece in inside(points, panel) {
                    chart.draw_series(LineSeries::new(piece, colour.stroke_width(*width)))?;
                }
            }
            Series::Band(lower, upper, colour) => {
                let ring = lower.iter().chain(upper.iter().rev());
                let ring: Points = ring.map(|point| clamped(*point, panel)).collect();
                chart.draw_series(std::iter::once(Polygon::new(
                    ring,
                    colour.mix(0.2).filled(),
                )))?;
            }
            Series::Bars(bars, colour) => {
                chart.draw_series(bars.iter().map(|&(left, right, height)| {
                    let corners = [clamped((left, 0.0), panel), clamped((right, height), panel)];
                    Rectangle::new(corners, colour.mix(0.5).filled())
                }))?;
            }
            Series::Marks(points, colour) => {
                let seen = points.iter().filter(|point| is_inside(**point, panel));
                chart.draw_series(seen.map(|point| Circle::new(*point, 3, colour.filled())))?;
            }
        }
    }
    draw_legend(cell, panel)
}

/// Draws names in their colours, below one another at the top right.
fn draw_legend(cell: &Cell, panel: &Panel) -> Result<(), Box<dyn Error>> {
    use plotters::style::text_anchor::{HPos, Pos, VPos};
    let (width, _) = cell.dim_in_pixel();
    for (n, (name, colour)) in panel.legend.iter().enumerate() {
        let style = TextStyle::from(LABEL.into_font())
            .color(colour)
            .pos(Pos::new(HPos::Right, VPos::Top));
        cell.draw_text(name, &style, (width as i32 - 14, 30 + 14 * n as i32))?;
    }
    Ok(())
}

/// Formats a label with as many digits as it needs.
fn number(value: f64) -> String {
    let rounded = (value * 1e6).round() / 1e6;
    format!("{}", rounded + 0.0)
}

fn is_inside((x, y): (f64, f64), panel: &Panel) -> bool {
    (panel.x.start..=panel.x.end).contains(&x) && (panel.y.start..=panel.y.end).contains(&y)
}

fn clamped((x, y): (f64, f64), panel: &Panel) -> (f64, f64) {
    (
        x.clamp(panel.x.start, panel.x.end),
        y.clamp(panel.y.start, panel.y.end),
    )
}

/// Returns the pieces of a curve that lie inside.
fn inside(points: &Points, panel: &Panel) -> Vec<Points> {
    let pieces = points.split(|point| !is_inside(*point, panel));
    pieces
        .filter(|piece| piece.len() > 1)
        .map(|piece| without_flat_runs(piece, panel))
        .collect()
}

/// Removes the points between which a curve stays inside half a pixel: files stay small.
fn without_flat_runs(piece: &[(f64, f64)], panel: &Panel) -> Points {
    let half_pixel = 0.5 * (panel.y.end - panel.y.start) / f64::from(PANEL.1);
    let width = (panel.x.end - panel.x.start) / f64::from(PANEL.0);
    let mut kept: Points = Vec::new();
    let last = piece.len().saturating_sub(1);
    for (n, point) in piece.iter().enumerate() {
        let flat = kept.last().is_some_and(|(x, y)| {
            let near = (point.1 - y).abs() < half_pixel;
            near && point.0 >= *x && point.0 - x < 20.0 * width
        });
        if !flat || n == 0 || n == last {
            // Where a run ends, its end is a corner.
            if let Some(before) = piece.get(n.wrapping_sub(1))
                && kept.last() != Some(before)
            {
                kept.push(*before);
            }
            kept.push(*point);
        }
    }
    kept
}
