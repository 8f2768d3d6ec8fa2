//! A certificate as one page that prints, and as text.

use std::fmt::Write as _;

use fleetcal_proto::calibration::Envelope;
use fleetcal_proto::certificate::CertificateDocument;

use crate::facts::{Section, sections};

/// Head of the page, whose policy forbids requests and scripts. On paper it is one page of A4.
const HEAD: &str = "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n\
<meta name=\"viewport\" content=\"width=device-width\">\n\
<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'\">\n\
<style>\
@page{size:A4;margin:12mm}\
body{font:14px/1.35 sans-serif;max-width:820px;margin:1.5em auto;padding:0 1em;color:#222;background:#fff}\
h1{font-size:1.5em;margin:0 0 .2em}h2{font-size:1em;margin:.9em 0 .2em}\
section{break-inside:avoid;overflow-x:auto}\
table{border-collapse:collapse;width:100%}\
th,td{text-align:left;vertical-align:top;padding:.12em .8em .12em 0;border-bottom:1px solid #ddd;overflow-wrap:anywhere}\
th{font-weight:600}th[scope=row]{font-weight:400}th:first-child,td:first-child{width:24%}\
code{font-size:.9em}footer{margin-top:1em;border-top:2px solid #222;padding-top:.4em;overflow-wrap:anywhere}\
@media print{body{font-size:9.5px;margin:0;max-width:none;padding:0}}\
</style>\n";

/// Makes the page of a certificate, which was opened from its envelope.
pub fn page(certificate: &CertificateDocument, envelope: &Envelope) -> String {
    let mut page = HEAD.to_owned();
    let title = escaped(&title(certificate));
    let head = format!(
        "<title>{title}</title>\n<main>\n<h1>{title}</h1>\n<p>Verified on {}.</p>\n",
        escaped(&certificate.verification.at)
    );
    page.push_str(&head);
    for section in sections(certificate) {
        page.push_str(&table(&section));
    }
    let foot = format!(
        "</main>\n<footer>This page shows a signed document. To check it: <code>fleetcal verify \
         certificate-{}.json --key KEY</code><br>SHA-256 {}<br>Key {}<br>Signature {}</footer>\n</html>\n",
        certificate.number,
        escaped(&envelope.sha256),
        escaped(&envelope.key_id),
        escaped(&envelope.signature),
    );
    page.push_str(&foot);
    page
}

/// Makes the text of a certificate.
pub fn text(certificate: &CertificateDocument) -> String {
    let mut text = format!("{}\n", title(certificate));
    for section in sections(certificate) {
        let head = headed(&section);
        let rows: Vec<Vec<String>> = head.into_iter().chain(section.rows).collect();
        let widths = widths(&rows);
        let lines = rows.iter().map(|row| line(row, &widths));
        let lines: Vec<String> = lines.map(|line| line.trim_end().to_owned()).collect();
        for part in ["\n", section.title, "\n", &lines.join("\n"), "\n"] {
            text.push_str(part);
        }
    }
    text
}

fn title(certificate: &CertificateDocument) -> String {
    format!(
        "Calibration certificate {} of {}",
        certificate.number, certificate.robot
    )
}

/// Heads of a section's columns, if it has any.
fn headed(section: &Section) -> Option<Vec<String>> {
    let head = section.head.iter().map(|&cell| cell.to_owned());
    (!section.head.is_empty()).then(|| head.collect())
}

/// Widths of the columns of some rows, in characters.
fn widths(rows: &[Vec<String>]) -> Vec<usize> {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column));
        cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    (0..columns).map(width).collect()
}

fn line(row: &[String], widths: &[usize]) -> String {
    let mut line = String::new();
    for (cell, width) in row.iter().zip(widths) {
        // Writing into a string does not fail.
        if write!(line, "  {}", printable(cell)).is_err() {
            break;
        }
        let padding = width.saturating_sub(cell.chars().count());
        line.extend(std::iter::repeat_n(' ', padding));
    }
    line
}

/// Replaces control characters, which would move a terminal's cursor.
fn printable(text: &str) -> String {
    let shown = |letter: char| if letter.is_control() { ' ' } else { letter };
    text.chars().map(shown).collect()
}

fn table(section: &Section) -> String {
    let line = |row: &[String], is_head: bool| -> String {
        let cells = row.iter().enumerate().map(|(column, cell)| {
            let cell = escaped(cell);
            match (is_head, column) {
                (true, 0) => "<td></td>".to_owned(),
                (true, _) => format!("<th scope=\"col\">{cell}</th>"),
                (false, 0) => format!("<th scope=\"row\">{cell}</th>"),
                (false, _) => format!("<td>{cell}</td>"),
            }
        });
        format!("<tr>{}</tr>\n", cells.collect::<String>())
    };
    let head = headed(section);
    let head = head.map_or_else(String::new, |head| line(&head, true));
    let rows: String = section.rows.iter().map(|row| line(row, false)).collect();
    format!(
        "<section><h2>{}</h2>\n<table>\n{head}{rows}</table></section>\n",
        escaped(section.title)
    )
}

/// Escapes the characters that have a meaning in HTML.
fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            other => escaped.push(other),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use fleetcal_model::{
        CalibrationCovariance, DeploymentId, Generation, Motions, NisNoise, RevisionId, RobotId,
        VehicleModel,
    };
    use fleetcal_proto::calibration::{CalibrationFrame, CalibrationValues};
    use fleetcal_proto::certificate::{
        CertificateSchema, CertifiedAct, CertifiedCalibration, CertifiedCrossTrack,
        CertifiedEvidence, CertifiedVehicle, CertifiedVerification, CertifiedVersions,
    };
    use fleetcal_proto::signing::{KEY_BYTES, SigningKey, sign};

    use super::*;

    fn four(scale: f64) -> CalibrationValues {
        CalibrationValues {
            steering_offset_rad: 0.05 * scale,
            lidar_x_m: 0.434 * scale,
            lidar_y_m: -0.016 * scale,
            lidar_yaw_rad: 0.0133 * scale,
            ..CalibrationValues::default()
        }
    }

    fn evidence() -> CertifiedEvidence {
        CertifiedEvidence {
            from: "2026-11-21T12:00:00Z".to_owned(),
            to: "2026-11-21T12:03:00Z".to_owned(),
            distance_m: 151.26,
            motions: Some(Motions {
                left_m: 60.0,
                straight_m: 31.26,
                right_m: 60.0,
                reverse_m: 0.0,
            }),
            drive_samples: 18_000,
            scans: 1_800,
            nis_mean: 2.9,
            nis_dof: 3.0,
            nis_noise: Some(NisNoise::Configured),
            covariance: Some(CalibrationCovariance::default()),
        }
    }

    fn act(by: &str, reason: Option<&str>) -> CertifiedAct {
        CertifiedAct {
            by: by.to_owned(),
            at: "2026-11-21T12:05:00Z".to_owned(),
            reason: reason.map(str::to_owned),
        }
    }

    fn errors(generation: u64, rms_m: f64) -> CertifiedCrossTrack {
        CertifiedCrossTrack {
            generation: Generation(generation),
            count: 90,
            rms_m,
            mean_m: 0.001,
        }
    }

    fn certificate() -> CertificateDocument {
        CertificateDocument {
            schema: CertificateSchema::V1,
            number: DeploymentId(7),
            robot: RobotId::parse("tugger_01").unwrap(),
            vehicle: Some(CertifiedVehicle {
                model: VehicleModel::Bicycle,
                wheelbase_m: 1.2,
                speed_measured_at: None,
                nominal_lidar_in_base: None,
            }),
            calibration: CertifiedCalibration {
                generation: Generation(4),
                document_sha256: "ab".repeat(32),
                revision: RevisionId(17),
                values: four(1.0),
                sigmas: four(0.01),
                covariance: Some(CalibrationCovariance::default()),
                frame: CalibrationFrame::RearAxle,
                rear_axle_in_base_link: None,
            },
            evidence: Some(evidence()),
            evidence_sha256: "cd".repeat(32),
            verification: CertifiedVerification {
                at: "2026-11-21T12:10:00Z".to_owned(),
                distance_m: 61.5,
                residual: four(0.001),
                sigmas: four(0.0005),
                limits: Some(four(0.1)),
                evidence: Some(evidence()),
            },
            cross_track_before: Some(errors(3, 0.041)),
            cross_track_after: Some(errors(4, 0.0123)),
            requested: Some(act("fleetcal", None)),
            approved: vec![act(
                "ana",
                Some("<script>alert('x')</script>\u{1b}[2J & so"),
            )],
            applied: act("tugger_01", None),
            versions: CertifiedVersions {
                service: "0.2.0".to_owned(),
                estimator: "0.2.0".to_owned(),
            },
        }
    }

    #[test]
    fn page_and_text_say_what_the_document_says() {
        let key = SigningKey::from_bytes(&[7; KEY_BYTES]);
        let envelope = sign(&certificate(), &key).unwrap();
        let page = page(&certificate(), &envelope);
        let text = text(&certificate());
        for fact in [
            "Calibration certificate 7 of tugger_01",
            "bicycle",
            "1.200 m",
            "2.865°",
            "434.0 mm",
            "-16.0 mm",
            "0.762°",
            "61.5 m",
            "60.0 m to the left, 31.3 m straight, 60.0 m to the right; 0.0 m backwards",
            "2.90, 3 expected",
            "41.0 mm",
            "12.3 mm",
            "ana",
            "2026-11-21T12:05:00Z",
            "2026-11-21T12:10:00Z",
            &"cd".repeat(32),
            &"ab".repeat(32),
        ] {
            assert!(page.contains(fact), "{fact}");
            assert!(text.contains(fact), "{fact}");
        }
        for sealed in [&envelope.sha256, &envelope.key_id] {
            assert!(page.contains(sealed.as_str()), "{sealed}");
        }
    }

    #[test]
    fn what_people_wrote_stays_text() {
        let key = SigningKey::from_bytes(&[7; KEY_BYTES]);
        let envelope = sign(&certificate(), &key).unwrap();
        let page = page(&certificate(), &envelope);
        assert!(!page.contains("<script"), "{page}");
        assert!(page.contains("&lt;script&gt;alert(&#39;x&#39;)"));
        assert!(page.contains("&amp; so"));
        let text = text(&certificate());
        assert!(!text.contains('\u{1b}'), "{text}");
    }

    #[test]
    fn a_signed_certificate_comes_back_as_it_was_and_is_no_other_kind_of_text() {
        let key = SigningKey::from_bytes(&[7; KEY_BYTES]);
        let trusted = key.public_key().into();
        let envelope = sign(&certificate(), &key).unwrap();
        let file = serde_json::to_vec(&envelope).unwrap();
        let read = Envelope::from_json(&file).unwrap();
        let opened: CertificateDocument = read.open_as(&trusted).unwrap();
        assert_eq!(opened, certificate());
        let refused = read.open(&trusted).unwrap_err().to_string();
        assert!(refused.contains("fleetcal.certificate/1"), "{refused}");
    }

    #[test]
    fn any_changed_byte_of_the_file_is_refused() {
        let key = SigningKey::from_bytes(&[7; KEY_BYTES]);
        let trusted = key.public_key().into();
        let envelope = sign(&certificate(), &key).unwrap();
        let file = serde_json::to_vec(&envelope).unwrap();
        for place in 0..file.len() {
            let mut changed = file.clone();
            changed[place] ^= 0x01;
            let read = Envelope::from_json(&changed);
            let opened = read.and_then(|read| read.open_as::<CertificateDocument>(&trusted));
            assert!(opened.is_err(), "byte {place}");
        }
    }
}
