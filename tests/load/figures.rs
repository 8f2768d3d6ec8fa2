//! Figures of a load in the file that `make results` makes a page of.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};

/// Caption of the table.
const TABLE: &str = "Cost for the service, by thread and in all";

/// Adds the figures of a run, in place of those of the same robots.
pub fn add(file: &Path, row: &str, robots: usize, figures: &[(&str, f64, &str)]) {
    let text = fs::read_to_string(file).unwrap();
    let is_of_another = |line: &&str| {
        let figure: Value = serde_json::from_str(line).unwrap();
        figure["row"] != row
    };
    let mut lines: Vec<String> = text
        .lines()
        .filter(is_of_another)
        .map(str::to_owned)
        .collect();
    for (figure, value, unit) in figures {
        let value = (100.0 * value).round() / 100.0;
        let of = robots;
        let figure = json!({
            "table": TABLE, "row": row, "figure": figure, "value": value, "unit": unit, "of": of,
        });
        lines.push(figure.to_string());
    }
    fs::write(file, lines.join("\n") + "\n").unwrap();
}
