//! The result of a calibration as a person reads it: degrees and millimetres.

use fleetcal_fleet::words::{event, fit, word};
use fleetcal_model::{Parameter, ParameterStatus, Unit};
use fleetcal_proto::description::DescriptionDocument;
use fleetcal_proto::estimate::{CalibrationReport, ParameterDocument};
use serde_json::Value;

/// Formats the table that `fleetcal calibrate` prints.
pub fn table(report: &CalibrationReport) -> String {
    let mut lines = head(report);
    lines.extend(report.description.iter().flat_map(described));
    lines.push(String::new());
    lines.push(format!(
        "{:<16} {:>12}   {:>12}   {}",
        "parameter", "value", "2 sigma", "status"
    ));
    for (name, parameter) in report.parameters.iter() {
        if parameter.status != ParameterStatus::Off {
            lines.extend(row(name, parameter));
        }
    }
    lines.push(String::new());
    lines.extend(report.events.iter().map(event));
    lines.extend(tail(report));
    let mut text = lines.join("\n");
    text.push('\n');
    text
}

fn head(report: &CalibrationReport) -> Vec<String> {
    let model = word(&report.vehicle.model);
    vec![
        format!(
            "{}: {model}, wheelbase {:.3} m",
            report.robot, report.vehicle.wheelbase_m
        ),
        format!(
            "{:.1} s, {:.1} m, {} drive samples, {} scans ({} rejected)",
            report.duration_s,
            report.distance_m,
            report.drive_samples,
            report.scans,
            report.scans_rejected,
        ),
    ]
}

/// Lines on what was taken from the robot's own description, and on what it does not say.
fn described(description: &DescriptionDocument) -> Vec<String> {
    let mut lines = Vec::new();
    if !description.origins.is_empty() {
        lines.push(format!("description: {}", description.origins.join(", ")));
    }
    for value in &description.values {
        let used = if value.used { "" } else { " (not used)" };
        let (key, json, source) = (&value.key, &value.value, &value.source);
        lines.push(format!("  {key} = {}{used}, by {source}", shown(json)));
    }
    let missing = description.missing.iter();
    lines.extend(missing.map(|reason| format!("  without {reason}")));
    lines
}

/// Formats a described value: lengths to a tenth of a millimetre.
fn shown(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Number(number) => number.as_f64().map_or_else(
            || number.to_string(),
            |number| {
                let rounded = (number * 1e4).round() / 1e4;
                (rounded + 0.0).to_string()
            },
        ),
        Value::Array(items) => {
            let items: Vec<String> = items.iter().map(shown).collect();
            items.join(" and ")
        }
        Value::Object(fields) => {
            let fields: Vec<String> = fields
                .iter()
                .map(|(key, value)| format!("{key} {}", shown(value)))
                .collect();
            fields.join(", ")
        }
        other => other.to_string(),
    }
}

fn row(name: Parameter, parameter: &ParameterDocument) -> Vec<String> {
    let (value, sigma) = readable(parameter);
    let status = word(&parameter.status);
    let name = title(name);
    let mut lines = vec![format!("{name:<16} {value:>12}   ± {sigma:>10}   {status}")];
    if let Some(needs) = &parameter.needs {
        lines.push(format!("{:<16} needs: {needs}", ""));
    }
    lines
}

/// Returns a parameter's name for people.
pub fn title(name: Parameter) -> &'static str {
    match name {
        Parameter::SteeringOffset => "steering offset",
        Parameter::LidarX => "LiDAR x",
        Parameter::LidarY => "LiDAR y",
        Parameter::LidarYaw => "LiDAR yaw",
        Parameter::SpeedScale => "speed scale",
        Parameter::Wheelbase => "wheelbase",
        Parameter::TimeOffset => "time offset",
        Parameter::SteeringGain => "steering gain",
    }
}

/// Formats a value and its two sigmas in a unit for people.
pub fn readable(parameter: &ParameterDocument) -> (String, String) {
    let (value, sigma) = (parameter.value, 2.0 * parameter.sigma);
    match parameter.unit {
        Unit::Radian => (
            format!("{:.3}°", value.to_degrees()),
            format!("{:.3}°", sigma.to_degrees()),
        ),
        Unit::Metre => (format!("{value:.4} m"), format!("{:.1} mm", sigma * 1e3)),
        Unit::Second => (
            format!("{:.1} ms", value * 1e3),
            format!("{:.1} ms", sigma * 1e3),
        ),
        Unit::One => (format!("{value:.5}"), format!("{sigma:.5}")),
    }
}

fn tail(report: &CalibrationReport) -> Vec<String> {
    let (consistency, timing) = (&report.consistency, &report.timing);
    vec![
        format!(
            "consistency      NIS {:.2}, {:.0} expected, over {} updates. {}",
            consistency.nis_mean,
            consistency.nis_dof,
            consistency.samples,
            fit(consistency)
        ),
        format!(
            "timing           {:.2} ms a scan (99 % under {:.2} ms), {:.2} s of CPU time, {:.0} \
             times real time",
            timing.scan_median_ms, timing.scan_p99_ms, timing.cpu_s, timing.realtime_factor
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_shown_in_degrees_and_millimetres() {
        let parameter = |value, sigma, unit| ParameterDocument {
            value,
            sigma,
            unit,
            status: ParameterStatus::Converged,
            needs: None,
        };
        let shown = |value, sigma, unit| {
            let (value, sigma) = readable(&parameter(value, sigma, unit));
            format!("{value} ± {sigma}")
        };
        assert_eq!(shown(0.05, 0.000_5, Unit::Radian), "2.865° ± 0.057°");
        assert_eq!(shown(0.438, 0.000_4, Unit::Metre), "0.4380 m ± 0.8 mm");
        assert_eq!(shown(-0.01, 0.001, Unit::Second), "-10.0 ms ± 2.0 ms");
        assert_eq!(shown(1.002, 0.000_1, Unit::One), "1.00200 ± 0.00020");
    }

    #[test]
    fn needs_stand_below_their_parameter() {
        let parameter = ParameterDocument {
            value: 0.0,
            sigma: 1.0,
            unit: Unit::Metre,
            status: ParameterStatus::Unobservable,
            needs: Some("turns to both sides".to_owned()),
        };
        let lines = row(Parameter::LidarX, &parameter);
        assert!(
            lines
                .last()
                .is_some_and(|line| line.contains("needs: turns to both sides"))
        );
    }
}
