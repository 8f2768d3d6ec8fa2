//! Facts of a certificate, as people read them: in degrees and millimetres, under headings.

use fleetcal_model::{CalibrationCovariance, NisNoise, SpeedMeasuredAt};
use fleetcal_proto::calibration::CalibrationValues;
use fleetcal_proto::certificate::{
    CertificateDocument, CertifiedAct, CertifiedCrossTrack, CertifiedEvidence, CertifiedVehicle,
};

/// Facts under one heading.
pub(crate) struct Section {
    /// Heading.
    pub(crate) title: &'static str,
    /// Heads of the columns; empty for pairs of a name and its value.
    pub(crate) head: Vec<&'static str>,
    /// Rows, each with its name first.
    pub(crate) rows: Vec<Vec<String>>,
}

/// Sections of a certificate.
pub(crate) fn sections(certificate: &CertificateDocument) -> Vec<Section> {
    let mut sections = vec![
        pairs("Robot", robot(certificate)),
        values(certificate),
        verification(certificate),
    ];
    let covariance = certificate.calibration.covariance.as_ref();
    sections.extend(covariance.map(of_covariance));
    let evidence = certificate.evidence.as_ref();
    sections.extend(evidence.map(|one| pairs("Evidence of the values", of_evidence(one))));
    let evidence = certificate.verification.evidence.as_ref();
    sections.extend(evidence.map(|one| pairs("Evidence of the verification", of_evidence(one))));
    sections.extend(path(certificate));
    sections.push(people(certificate));
    sections.push(pairs("Versions and hashes", hashes(certificate)));
    sections
}

fn pairs(title: &'static str, rows: Vec<(&str, String)>) -> Section {
    Section {
        title,
        head: Vec::new(),
        rows: rows
            .into_iter()
            .map(|(name, value)| vec![name.to_owned(), value])
            .collect(),
    }
}

fn robot(certificate: &CertificateDocument) -> Vec<(&'static str, String)> {
    let mut rows = vec![("robot", certificate.robot.to_string())];
    if let Some(vehicle) = &certificate.vehicle {
        rows.extend(of_vehicle(vehicle));
    }
    rows.push(("generation", certificate.calibration.generation.to_string()));
    rows
}

fn of_vehicle(vehicle: &CertifiedVehicle) -> Vec<(&'static str, String)> {
    let mut rows = vec![
        ("vehicle", vehicle.model.name().to_owned()),
        ("wheelbase", format!("{:.3} m", vehicle.wheelbase_m)),
    ];
    if let Some(place) = vehicle.speed_measured_at {
        let place = match place {
            SpeedMeasuredAt::RearAxle => "rear axle".to_owned(),
            SpeedMeasuredAt::SteeredWheel => "steered wheel".to_owned(),
            SpeedMeasuredAt::RearWheel { lateral_m } => {
                format!("rear wheel {lateral_m:+.3} m to the left")
            }
        };
        rows.push(("speed measured at", place));
    }
    rows
}

/// One of the four values that every calibration has: name, unit, factor from SI, and part.
type Part = (
    &'static str,
    &'static str,
    f64,
    fn(&CalibrationValues) -> f64,
);

/// Degrees in a radian.
const DEG: f64 = 180.0 / std::f64::consts::PI;

const FOUR: [Part; 4] = [
    ("steering offset", "°", DEG, |values| {
        values.steering_offset_rad
    }),
    ("LiDAR x", "mm", 1e3, |values| values.lidar_x_m),
    ("LiDAR y", "mm", 1e3, |values| values.lidar_y_m),
    ("LiDAR yaw", "°", DEG, |values| values.lidar_yaw_rad),
];

fn shown(value: f64, (_, unit, factor, _): Part) -> String {
    let scaled = value * factor;
    if unit == "°" {
        format!("{scaled:.3}°")
    } else {
        format!("{scaled:.1} {unit}")
    }
}

fn values(certificate: &CertificateDocument) -> Section {
    let (values, sigmas) = (
        &certificate.calibration.values,
        &certificate.calibration.sigmas,
    );
    let row = |part: Part| {
        let (name, _, _, of) = part;
        vec![
            name.to_owned(),
            shown(of(values), part),
            shown(of(sigmas), part),
        ]
    };
    let mut rows: Vec<_> = FOUR.into_iter().map(row).collect();
    let sigma = |name| {
        let found = sigmas.fields().find(|(field, _)| *field == name);
        found.map_or(0.0, |(_, sigma)| sigma)
    };
    for (name, value) in values.fields().skip(FOUR.len()) {
        rows.push(vec![
            name.to_owned(),
            format!("{value:.4}"),
            format!("{:.4}", sigma(name)),
        ]);
    }
    Section {
        title: "Calibration",
        head: vec!["", "value", "sigma"],
        rows,
    }
}

fn verification(certificate: &CertificateDocument) -> Section {
    let verdict = &certificate.verification;
    let row = |part: Part| {
        let (name, _, _, of) = part;
        let limit = verdict.limits.as_ref().map(of);
        vec![
            name.to_owned(),
            shown(of(&verdict.residual), part),
            shown(of(&verdict.sigmas), part),
            limit.map_or_else(String::new, |limit| shown(limit, part)),
        ]
    };
    Section {
        title: "Verification: residual, with twice its sigma inside the limit",
        head: vec!["", "residual", "sigma", "limit"],
        rows: FOUR.into_iter().map(row).collect(),
    }
}

fn of_covariance(covariance: &CalibrationCovariance) -> Section {
    let rows = covariance.rows().iter().zip(FOUR);
    let row = |(row, (name, ..)): (&[f64; 4], Part)| {
        let entries = row.iter().map(|entry| format!("{entry:.3e}"));
        std::iter::once(name.to_owned()).chain(entries).collect()
    };
    Section {
        title: "Covariance of the values, in radians and metres",
        head: vec!["", "steering offset", "LiDAR x", "LiDAR y", "LiDAR yaw"],
        rows: rows.map(row).collect(),
    }
}

fn of_evidence(evidence: &CertifiedEvidence) -> Vec<(&'static str, String)> {
    let mut rows = vec![
        ("from", evidence.from.clone()),
        ("to", evidence.to.clone()),
        ("distance", format!("{:.1} m", evidence.distance_m)),
    ];
    if let Some(motions) = &evidence.motions {
        let driven = format!(
            "{:.1} m to the left, {:.1} m straight, {:.1} m to the right; {:.1} m backwards",
            motions.left_m, motions.straight_m, motions.right_m, motions.reverse_m
        );
        rows.push(("manoeuvres", driven));
    }
    let used = format!(
        "{} drive samples, {} scans",
        evidence.drive_samples, evidence.scans
    );
    let noise = match evidence.nis_noise {
        Some(NisNoise::Configured) => "configured",
        None => "learnt",
    };
    let nis = format!(
        "{:.2}, {:.0} expected by the {noise} noise",
        evidence.nis_mean, evidence.nis_dof
    );
    rows.extend([("messages", used), ("NIS", nis)]);
    rows
}

fn path(certificate: &CertificateDocument) -> Option<Section> {
    let row = |name: &str, errors: &CertifiedCrossTrack| {
        vec![
            format!("{name}, generation {}", errors.generation),
            format!("{:.1} mm", 1e3 * errors.rms_m),
            format!("{:.1} mm", 1e3 * errors.mean_m),
            errors.count.to_string(),
        ]
    };
    let before = certificate.cross_track_before.as_ref();
    let after = certificate.cross_track_after.as_ref();
    let rows: Vec<_> = [
        before.map(|e| row("before", e)),
        after.map(|e| row("after", e)),
    ]
    .into_iter()
    .flatten()
    .collect();
    (!rows.is_empty()).then(|| Section {
        title: "Cross-track error",
        head: vec!["", "RMS", "mean", "errors"],
        rows,
    })
}

fn people(certificate: &CertificateDocument) -> Section {
    let row = |what: &str, act: &CertifiedAct| {
        vec![
            what.to_owned(),
            act.by.clone(),
            act.at.clone(),
            act.reason.clone().unwrap_or_default(),
        ]
    };
    let requested = certificate.requested.iter().map(|act| row("proposed", act));
    let approved = certificate.approved.iter().map(|act| row("approved", act));
    let applied = std::iter::once(row("applied", &certificate.applied));
    let verified = vec![
        "verified".to_owned(),
        "fleetcal".to_owned(),
        certificate.verification.at.clone(),
        format!("after {:.1} m", certificate.verification.distance_m),
    ];
    let rows = requested.chain(approved).chain(applied);
    Section {
        title: "Decisions",
        head: vec!["", "by", "at", "reason"],
        rows: rows.chain(std::iter::once(verified)).collect(),
    }
}

fn hashes(certificate: &CertificateDocument) -> Vec<(&'static str, String)> {
    vec![
        ("service", certificate.versions.service.clone()),
        ("estimator", certificate.versions.estimator.clone()),
        (
            "SHA-256 of the evidence",
            certificate.evidence_sha256.clone(),
        ),
        (
            "SHA-256 on the robot",
            certificate.calibration.document_sha256.clone(),
        ),
    ]
}
