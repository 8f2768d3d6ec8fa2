//! Drawing of a figure as SVG. Its colours are those of the light scheme; the page's style replaces
//! them by their roles.

use std::error::Error;
use std::ops::Range;

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::CommandError;

/// Width of every figure, pixels: that of the smallest phone, so that no screen shrinks its labels
/// much.
const WIDTH: u32 = 340;
/// Width and height of a figure, pixels.
const SIZE: (u32, u32) = (WIDTH, 210);
/// Size of the path's figure, which shows both axes to the same scale, pixels.
const SQUARE: (u32, u32) = (WIDTH, WIDTH);
/// Height of the letters, pixels.
const LETTERS: u32 = 15;
/// Font requested from the drawing library, which requires a whole size and divides it by 1.24.
const FONT: (&str, f64) = ("sans-serif", 19.0);
/// Least width at which a page may show a figure, pixels: its letters are then 12 pixels high.
pub(super) const WIDTH_MIN: u32 = WIDTH * 12 / LETTERS;
/// Most labels of an axis that do not touch each other.
const LABELS_MAX: usize = 5;
/// Colours of the light scheme, by their roles.
const ACCENT: RGBColor = RGBColor(0x0b, 0x66, 0x71);
const INK: RGBColor = RGBColor(0x12, 0x18, 0x1d);
const FAINT: RGBColor = RGBColor(0x5d, 0x68, 0x72);
const LINE: RGBColor = RGBColor(0xdf, 0xe4, 0xe8);

/// Style by which a page gives the colours of figures their roles.
pub(super) const STYLE: &str = "svg{display:block;width:100%;height:auto}\
svg [fill=\"#0B6671\"]{fill:var(--accent)}svg [stroke=\"#0B6671\"]{stroke:var(--accent)}\
svg [fill=\"#12181D\"]{fill:var(--ink)}svg [stroke=\"#12181D\"]{stroke:var(--ink)}\
svg [fill=\"#5D6872\"]{fill:var(--ink-faint)}svg [stroke=\"#5D6872\"]{stroke:var(--ink-faint)}\
svg [stroke=\"#DFE4E8\"]{stroke:var(--line)}";

/// Points of a curve.
pub(super) type Points = Vec<(f64, f64)>;

/// Scale of the values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scale {
    /// Equal steps are equal differences.
    Linear,
    /// Values are logarithms to the base of ten.
    Logarithm,
    /// Both axes have the same scale.
    Square,
}

/// One pair of axes with its curves and marks at certain times.
pub(super) struct Chart<'a> {
    pub x: Range<f64>,
    pub y: Range<f64>,
    pub x_name: &'a str,
    pub y_name: &'a str,
    pub scale: Scale,
    /// Curves, each without a gap.
    pub curves: Vec<Points>,
    /// Points without a curve.
    pub dots: Points,
    /// Lower and upper edges of shaded stretches.
    pub bands: Vec<[Points; 2]>,
    /// Expected value.
    pub level: Option<f64>,
    /// Times of events, which are numbered.
    pub marks: &'a [f64],
}

/// Draws a chart.
///
/// # Errors
/// The drawing library fails.
pub(super) fn svg(chart: &Chart) -> Result<String, CommandError> {
    let mut svg = String::new();
    draw(&mut svg, chart).map_err(|error| CommandError::Figure(error.to_string()))?;
    Ok(svg)
}

fn draw(svg: &mut String, shown: &Chart) -> Result<(), Box<dyn Error>> {
    let size = if shown.scale == Scale::Square {
        SQUARE
    } else {
        SIZE
    };
    let root = SVGBackend::with_string(svg, size).into_drawing_area();
    let mut chart = ChartBuilder::on(&root)
        .margin(8)
        .margin_top(22)
        .x_label_area_size(44)
        .y_label_area_size(62)
        .build_cartesian_2d(shown.x.clone(), shown.y.clone())?;
    let letters = FONT.into_font().color(&FAINT);
    let (x_step, y_step) = (step(&shown.x), step(&shown.y));
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(LINE)
        .axis_style(FAINT)
        .x_labels(LABELS_MAX)
        .y_labels(LABELS_MAX)
        .x_label_formatter(&|x: &f64| number(*x, x_step))
        .y_label_formatter(&|y: &f64| match shown.scale {
            Scale::Logarithm => power_of_ten(*y),
            Scale::Linear | Scale::Square => number(*y, y_step),
        })
        .label_style(letters.clone())
        .axis_desc_style(letters)
        .x_desc(shown.x_name)
        .y_desc(shown.y_name)
        .draw()?;
    let inside = |&(x, y): &(f64, f64)| {
        (
            x.clamp(shown.x.start, shown.x.end),
            y.clamp(shown.y.start, shown.y.end),
        )
    };
    for [lower, upper] in &shown.bands {
        let ring: Points = lower.iter().chain(upper.iter().rev()).map(inside).collect();
        let area = Polygon::new(ring, ACCENT.mix(0.18).filled());
        chart.draw_series(std::iter::once(area))?;
    }
    if let Some(level) = shown.level {
        let line = [(shown.x.start, level), (shown.x.end, level)];
        chart.draw_series(DashedLineSeries::new(line, 6, 4, FAINT.stroke_width(1)))?;
    }
    for (mark, number) in shown.marks.iter().zip(1..) {
        let top = (*mark, shown.y.end);
        let line = [(*mark, shown.y.start), top];
        chart.draw_series(DashedLineSeries::new(line, 3, 3, INK.stroke_width(1)))?;
        let style = FONT.into_font().color(&INK);
        let style = style.pos(Pos::new(HPos::Center, VPos::Bottom));
        let label = Text::new(number.to_string(), top, style);
        chart.draw_series(std::iter::once(label))?;
    }
    for curve in &shown.curves {
        let curve = curve.iter().map(inside);
        chart.draw_series(LineSeries::new(curve, ACCENT.stroke_width(2)))?;
    }
    let dots = shown.dots.iter().map(inside);
    chart.draw_series(dots.map(|at| Circle::new(at, 2, ACCENT.filled())))?;
    root.present()?;
    Ok(())
}

/// Returns the distance of labels of an axis, about.
fn step(range: &Range<f64>) -> f64 {
    (range.end - range.start) / LABELS_MAX as f64
}

/// Writes a number with as many digits as steps of this size need, and a true minus sign.
fn number(value: f64, step: f64) -> String {
    let decimals = (-step.log10()).ceil().clamp(0.0, 6.0) as usize;
    let text = format!("{value:.decimals$}");
    let is_zero = text
        .trim_start_matches('-')
        .bytes()
        .all(|c| c == b'0' || c == b'.');
    if is_zero {
        text.trim_start_matches('-').to_owned()
    } else {
        text.replace('-', "\u{2212}")
    }
}

/// Writes the number that a logarithm is of, with two digits.
fn power_of_ten(logarithm: f64) -> String {
    let value = 10_f64.powf(logarithm);
    number(value, 10_f64.powf(logarithm.floor() - 0.5))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_have_a_true_minus_and_equally_many_digits() {
        assert_eq!(number(-0.1, 0.01), "\u{2212}0.10");
        assert_eq!(number(-0.001, 0.01), "0.00");
        assert_eq!(number(20.0, 5.0), "20");
    }

    #[test]
    fn labels_of_logarithms_are_the_numbers_themselves() {
        assert_eq!(
            [-0.5, 0.0, 0.5, 2.0].map(power_of_ten),
            ["0.32", "1.0", "3.2", "100"]
        );
    }
}
