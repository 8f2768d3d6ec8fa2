//! `calibrate --report`: one HTML page that needs nothing else, with its figures in it, in the
//! dashboard's colours.

mod draw;
mod figure;

use std::path::Path;

use fleetcal_fleet::words::{event, fit, word};
use fleetcal_model::{CalibrationCovariance, ModelFit, ParameterStatus, RobotTime, Unit, WallTime};
use fleetcal_proto::estimate::{CalibrationReport, ParameterDocument};
use jiff::Timestamp;

use crate::CommandError;
use crate::session_record::SessionRecord;
use crate::table::title;
use figure::{Figure, sentence_case};

/// Head of the page, whose policy forbids requests and scripts.
const HEAD: &str = "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n\
<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'\">\n";
/// Colours of the dashboard, in both schemes.
const COLOURS: &str = include_str!("../../../../web/src/tokens.css");
/// Sizes of the dashboard, as `docs/style-guide.md` has them.
const STYLE: &str = "\
*{box-sizing:border-box}\
body{margin:0 auto;padding:20px;max-width:1100px;background:var(--bg);color:var(--ink);\
font:14px/1.45 system-ui,'Segoe UI',Roboto,'Liberation Sans',sans-serif;font-variant-numeric:tabular-nums}\
h1{font-size:22px;line-height:30px;margin:0}h2{font-size:15px;line-height:22px;margin:0 0 8px}\
h3{font-size:14px;line-height:20px;margin:0}p,ol,dl,dd,figure{margin:0}\
.soft{color:var(--ink-soft)}.faint{color:var(--ink-faint);font-size:12.5px}\
.card{padding:14px 16px;margin-top:14px;border:1px solid var(--line);border-radius:8px;\
background:var(--surface);box-shadow:var(--shadow);min-width:0}\
.verdict{font-weight:550}.wrong{color:var(--bad)}\
.figures{display:grid;gap:0 14px;grid-template-columns:repeat(auto-fill,minmax(min(100%,440px),1fr))}\
.scroll{overflow-x:auto}table{width:100%;border-spacing:0}\
th,td{padding:5px 12px 5px 0;border-top:1px solid var(--line);text-align:left;vertical-align:top}\
thead :is(th,td){border-top:none;color:var(--ink-soft);font-size:12.5px;font-weight:500}\
th{font-weight:550}th small{display:block;color:var(--ink-soft);font-size:12.5px;font-weight:400}\
:is(th,td).number{text-align:right;white-space:nowrap}\
dl div{display:flex;flex-wrap:wrap;justify-content:space-between;gap:0 16px;padding:4px 0;border-top:1px solid var(--line)}\
dt{color:var(--ink-soft)}dd{overflow-wrap:anywhere}ol{padding-left:24px}\
summary{padding:4px 0;color:var(--accent);font-size:12.5px;cursor:pointer}\
details .scroll{max-height:260px;overflow-y:auto}\
:focus-visible{outline:2px solid var(--accent);outline-offset:2px;border-radius:4px}\
@media(max-width:560px){body{padding:10px}.card{padding:10px 8px}th,td{padding-right:8px}\
summary{min-height:44px;line-height:36px}}\
@media print{details{display:none}.card{break-inside:avoid;box-shadow:none}}";

/// Writes the page. `made` is the time of its making.
///
/// # Errors
/// A figure cannot be drawn or the file cannot be written.
pub fn write(
    path: &Path,
    recording: &Path,
    report: &CalibrationReport,
    session: &SessionRecord,
    made: WallTime,
) -> Result<(), CommandError> {
    let page = page(recording, report, session, made)?;
    std::fs::write(path, page).map_err(|source| CommandError::Write {
        path: path.to_owned(),
        source,
    })
}

fn page(
    recording: &Path,
    report: &CalibrationReport,
    session: &SessionRecord,
    made: WallTime,
) -> Result<String, CommandError> {
    let robot = escaped(report.robot.as_str());
    let mut page = HEAD.to_owned();
    let head = format!(
        "<title>Calibration of {robot}</title>\n<style>{COLOURS}{STYLE}{}svg{{min-width:{}px}}</style>\n\
         <main>\n<h1>Calibration of {robot}</h1>\n{}",
        draw::STYLE,
        draw::WIDTH_MIN,
        verdict(report),
    );
    page.push_str(&head);
    page.push_str(&parameters(report));
    page.push_str(&figures(&figure::parameters(report, session)?));
    page.push_str(&consistency(report));
    page.push_str(&figures(&figure::consistency(report, session)?));
    page.push_str(&events(report));
    page.push_str(&correlations(&report.covariance));
    page.push_str(&figures(figure::path(session)?.as_slice()));
    page.push_str(&facts(recording, report, session, made));
    page.push_str("</main>\n</html>\n");
    Ok(page)
}

/// Makes the answer: the values that are still to be learnt. One that the configuration fixes is not.
fn verdict(report: &CalibrationReport) -> String {
    let open: Vec<&str> = report
        .parameters
        .iter()
        .filter(|(name, parameter)| {
            CalibrationCovariance::OF.contains(name)
                && matches!(
                    parameter.status,
                    ParameterStatus::Learning | ParameterStatus::Unobservable
                )
        })
        .map(|(name, _)| title(name))
        .collect();
    let words = if open.is_empty() {
        "Steering offset and LiDAR mount are known.".to_owned()
    } else {
        format!("Not known well enough yet: {}.", open.join(", "))
    };
    format!("<p class=\"soft\">{words}</p>\n")
}

fn parameters(report: &CalibrationReport) -> String {
    let mut rows = Vec::new();
    for (name, parameter) in report.parameters.iter() {
        if parameter.status == ParameterStatus::Off {
            continue;
        }
        let (value, sigma) = shown(parameter);
        let needs = parameter.needs.as_deref().unwrap_or_default();
        rows.push(format!(
            "<tr><th scope=\"row\">{}<small>{}</small></th><td class=\"number\">{value}</td>\
             <td class=\"number\">{sigma}</td><td>{}</td></tr>\n",
            sentence_case(title(name)),
            escaped(needs),
            word(&parameter.status),
        ));
    }
    let head = "<th scope=\"col\">Parameter</th><th scope=\"col\" class=\"number\">Value</th>\
                <th scope=\"col\" class=\"number\">± sigma</th><th scope=\"col\">Status</th>";
    card("Parameters", &table("Parameters", head, &rows))
}

/// Formats value and sigma in the dashboard's units.
fn shown(parameter: &ParameterDocument) -> (String, String) {
    let (scale, decimals, unit) = match parameter.unit {
        Unit::Radian => (180.0 / std::f64::consts::PI, 3, "°"),
        Unit::Metre => (1e3, 1, " mm"),
        Unit::Second => (1e3, 1, " ms"),
        Unit::One => (1.0, 4, ""),
    };
    let number = |value: f64| {
        let text = format!("{:.decimals$}{unit}", scale * value);
        text.replace('-', "\u{2212}")
    };
    (number(parameter.value), number(parameter.sigma))
}

fn consistency(report: &CalibrationReport) -> String {
    let consistency = &report.consistency;
    let class = match consistency.fit {
        Some(ModelFit::Unexplained) => "verdict wrong",
        Some(ModelFit::Explained | ModelFit::Rough) | None => "verdict",
    };
    let words = format!(
        "<p class=\"{class}\">{}</p>\n<p class=\"faint\">An innovation is the measured motion less the \
         predicted one. NIS, the normalised innovation squared, compares it with what the configured \
         noise lets expect: {:.0} on average; here {:.2} over the last {} updates. Below the shaded range \
         the noise is less than configured, which is safe; above it something moves the robot that is \
         not in the model.</p>\n",
        escaped(&fit(consistency)),
        consistency.nis_dof,
        consistency.nis_mean,
        consistency.samples,
    );
    card("Does the model explain the data?", &words)
}

fn events(report: &CalibrationReport) -> String {
    if report.events.is_empty() {
        return card("Events", "<p class=\"soft\">No change and no fault.</p>\n");
    }
    let items = report.events.iter().map(event);
    let items: Vec<String> = items
        .map(|one| format!("<li>{}</li>\n", escaped(&one)))
        .collect();
    let list = format!(
        "<p class=\"faint\">Figures mark them by their numbers.</p>\n<ol>\n{}</ol>\n",
        items.concat()
    );
    card("Events", &list)
}

/// Makes the table of correlations: the covariance over both sigmas.
fn correlations(covariance: &CalibrationCovariance) -> String {
    let rows = covariance.rows();
    let sigma: Vec<f64> = (0..rows.len())
        .filter_map(|i| Some(rows.get(i)?.get(i)?.sqrt()))
        .collect();
    let head: Vec<String> = CalibrationCovariance::OF
        .iter()
        .map(|&name| {
            let name = sentence_case(title(name));
            format!("<th scope=\"col\" class=\"number\">{name}</th>")
        })
        .collect();
    let of = CalibrationCovariance::OF.iter().zip(rows).zip(&sigma);
    let lines: Vec<String> = of
        .map(|((&name, row), sigma_row)| {
            let cells: Vec<String> = row
                .iter()
                .zip(&sigma)
                .map(|(entry, sigma_column)| {
                    let correlation = entry / (sigma_row * sigma_column);
                    let text = if correlation.is_finite() {
                        format!("{correlation:.2}").replace('-', "\u{2212}")
                    } else {
                        String::new()
                    };
                    format!("<td class=\"number\">{text}</td>")
                })
                .collect();
            let name = sentence_case(title(name));
            format!("<tr><th scope=\"row\">{name}</th>{}</tr>\n", cells.concat())
        })
        .collect();
    let words = "<p class=\"faint\">Errors of two values that go together: near 0 each is known by \
                 itself, near ±1 only their combination is.</p>\n";
    let head = format!("<td></td>{}", head.concat());
    let table = table("Correlations", &head, &lines);
    card("Correlations", &format!("{words}{table}"))
}

/// Makes the facts of the recording and of the page.
fn facts(
    recording: &Path,
    report: &CalibrationReport,
    session: &SessionRecord,
    made: WallTime,
) -> String {
    let ends = [session.estimates.first(), session.estimates.last()];
    let [from, to] = ends.map(|one| one.map_or_else(String::new, |one| when(one.stamp_ns)));
    let rows = [
        ("Recording", escaped(&recording.display().to_string())),
        ("From", from),
        ("To", to),
        (
            "Vehicle",
            format!(
                "{}, wheelbase {:.3} m",
                word(&report.vehicle.model),
                report.vehicle.wheelbase_m
            ),
        ),
        (
            "Driven",
            format!("{:.1} m in {:.1} s", report.distance_m, report.duration_s),
        ),
        ("Drive samples", report.drive_samples.to_string()),
        (
            "Scans",
            format!("{}, {} not usable", report.scans, report.scans_rejected),
        ),
        (
            "Made",
            format!(
                "{} by fleetcal {}",
                when(RobotTime(made.0)),
                env!("CARGO_PKG_VERSION")
            ),
        ),
    ];
    let rows = rows.map(|(term, value)| format!("<div><dt>{term}</dt><dd>{value}</dd></div>\n"));
    card("Recording", &format!("<dl>\n{}</dl>\n", rows.concat()))
}

/// Writes a time for people, UTC to the second.
fn when(stamp: RobotTime) -> String {
    Timestamp::from_nanosecond(stamp.0.into())
        .map(|time| time.strftime("%-d %b %Y, %H:%M:%S UTC").to_string())
        .unwrap_or_default()
}

fn figures(figures: &[Figure]) -> String {
    let shown: Vec<String> = figures.iter().map(shown_figure).collect();
    format!("<div class=\"figures\">\n{}</div>\n", shown.concat())
}

/// Makes a figure with the table of its numbers behind it.
fn shown_figure(figure: &Figure) -> String {
    let name = escaped(&figure.name);
    let svg = figure.svg.replacen(
        "<svg ",
        &format!("<svg role=\"img\" aria-label=\"{name}\" "),
        1,
    );
    let head: Vec<String> = figure
        .head
        .iter()
        .map(|name| format!("<th scope=\"col\" class=\"number\">{name}</th>"))
        .collect();
    let rows: Vec<String> = figure
        .rows
        .iter()
        .map(|row| {
            let cells = row.iter().map(|value| {
                let text = format!("{value:.4}").replace('-', "\u{2212}");
                format!("<td class=\"number\">{text}</td>")
            });
            format!("<tr>{}</tr>", cells.collect::<String>())
        })
        .collect();
    format!(
        "<figure class=\"card\">\n<figcaption><h3>{name}</h3><p class=\"faint\">{}</p></figcaption>\n\
         <div class=\"scroll\">{svg}</div>\n<details><summary>Numbers of {name}</summary>\n{}</details>\n\
         </figure>\n",
        figure.band,
        table(&format!("Numbers of {name}"), &head.concat(), &rows)
    )
}

fn card(title: &str, content: &str) -> String {
    format!("<section class=\"card\">\n<h2>{title}</h2>\n{content}</section>\n")
}

/// Makes a table that scrolls by itself where the screen is narrower.
fn table(name: &str, head: &str, rows: &[String]) -> String {
    format!(
        "<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"{name}\">\n<table>\n\
         <thead><tr>{head}</tr></thead>\n<tbody>\n{}</tbody>\n</table>\n</div>\n",
        rows.concat()
    )
}

/// Escapes text for HTML.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
