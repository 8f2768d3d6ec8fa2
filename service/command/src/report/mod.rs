//! `calibrate --report`: one HTML page that needs nothing else, with its figures in it.

mod figure;

use std::fmt::Write as _;
use std::path::Path;

use fleetcal_fleet::words::{event, word};
use fleetcal_model::ParameterStatus;
use fleetcal_proto::estimate::CalibrationReport;

use crate::CommandError;
use crate::session_record::SessionRecord;
use crate::table::{readable, title};

/// Head of the page, whose policy forbids requests and scripts.
const HEAD: &str = "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n\
<meta name=\"viewport\" content=\"width=device-width\">\n\
<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'\">\n\
<style>\
body{font:15px/1.45 sans-serif;max-width:960px;margin:2em auto;padding:0 1em;color:#222}\
table{border-collapse:collapse}th,td{text-align:left;padding:.25em 1em .25em 0;border-bottom:1px solid #ddd}\
td.number{text-align:right;font-variant-numeric:tabular-nums}\
figure,.table{margin:0;overflow-x:auto}figcaption{color:#555}svg{width:100%;height:auto}\
.figures{display:grid;gap:1.5em 1em;margin:1.5em 0;\
grid-template-columns:repeat(auto-fill,minmax(min(100%,440px),1fr))}\
</style>\n";

/// Writes the page.
///
/// # Errors
/// A figure cannot be drawn or the file cannot be written.
pub fn write(
    path: &Path,
    recording: &Path,
    report: &CalibrationReport,
    session: &SessionRecord,
) -> Result<(), CommandError> {
    let page = page(recording, report, session)?;
    std::fs::write(path, page).map_err(|source| CommandError::Write {
        path: path.to_owned(),
        source,
    })
}

fn page(
    recording: &Path,
    report: &CalibrationReport,
    session: &SessionRecord,
) -> Result<String, CommandError> {
    let mut page = HEAD.to_owned();
    let robot = escaped(report.robot.as_str());
    let vehicle = word(&report.vehicle.model);
    let facts = format!(
        "<title>Calibration of {robot}</title>\n<h1>Calibration of {robot}</h1>\n\
         <p>{}: {vehicle}, wheelbase {:.3} m; {:.1} s, {:.1} m, {} drive samples, {} scans \
         ({} rejected). NIS {:.2}, {:.0} expected.</p>\n",
        escaped(&recording.display().to_string()),
        report.vehicle.wheelbase_m,
        report.duration_s,
        report.distance_m,
        report.drive_samples,
        report.scans,
        report.scans_rejected,
        report.consistency.nis_mean,
        report.consistency.nis_dof,
    );
    page.push_str(&facts);
    page.push_str(&parameters(report));
    if !report.events.is_empty() {
        page.push_str("<h2>What happened</h2>\n<ul>\n");
        for change in &report.events {
            // Writing into a string does not fail.
            if writeln!(page, "<li>{}</li>", escaped(&event(change))).is_err() {
                break;
            }
        }
        page.push_str("</ul>\n");
    }
    let least = figure::WIDTH_MIN;
    let figures = format!("<style>svg{{min-width:{least}px}}</style>\n<div class=\"figures\">\n");
    page.push_str(&figures);
    for (caption, svg) in figure::figures(report, session)? {
        let shown = format!(
            "<figure tabindex=\"0\">\n<figcaption>{}</figcaption>\n{svg}\n</figure>\n",
            escaped(caption)
        );
        page.push_str(&shown);
    }
    page.push_str("</div>\n</html>\n");
    Ok(page)
}

fn parameters(report: &CalibrationReport) -> String {
    let mut table =
        "<div class=\"table\" tabindex=\"0\">\n<table>\n<tr><th>Parameter<th>Value<th>± 2 sigma<th>Status<th>Needs</tr>\n".to_owned();
    for (name, parameter) in report.parameters.iter() {
        if parameter.status == ParameterStatus::Off {
            continue;
        }
        let (value, sigma) = readable(parameter);
        let row = format!(
            "<tr><td>{}<td class=\"number\">{value}<td class=\"number\">{sigma}<td>{}<td>{}</tr>\n",
            title(name),
            word(&parameter.status),
            escaped(parameter.needs.as_deref().unwrap_or_default()),
        );
        table.push_str(&row);
    }
    table.push_str("</table>\n</div>\n");
    table
}

/// Escapes text for HTML.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
