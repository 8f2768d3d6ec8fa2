//! Certificates of verified calibrations.

use fleetcal_model::{DeploymentId, WallTime};
use fleetcal_proto::certificate::CertificateDocument;
use fleetcal_store::{CertificateFilter, CertificateRecord};

use super::driven::Driver;
use super::*;

/// Certificates of the store, newest first.
async fn certificates(bench: &Bench) -> Vec<CertificateRecord> {
    let filter = CertificateFilter {
        limit: 100,
        ..CertificateFilter::default()
    };
    bench.store.certificates(&filter).await.unwrap()
}

fn opened(bench: &Bench, certificate: &CertificateRecord) -> CertificateDocument {
    let trusted = TrustedKeys::from(bench.lifecycle.public_key());
    certificate.envelope.open_as(&trusted).unwrap()
}

#[tokio::test]
async fn a_verified_calibration_has_its_certificate_and_no_other_has() {
    let bench = Bench::open(Policy::default()).await;
    bench.approve(0.02, None).await;
    let generation = bench.drive_in_verification().await;
    assert!(certificates(&bench).await.is_empty());
    bench.verify(true).await;
    let kept = certificates(&bench).await;
    assert_eq!(kept.len(), 1);
    let deployment = bench.latest().await;
    assert_eq!(deployment.state, DeploymentState::Verified);
    let found = &kept[0];
    assert_eq!(
        (found.number, &found.robot, found.verified_ns),
        (deployment.id, &robot(), bench.clock.now())
    );
    assert_eq!(found.approved_by, "ana, bruno");
    let document = opened(&bench, found);
    let (proposal, revision) = {
        let id = deployment.proposal.unwrap();
        bench.store.proposal(id).await.unwrap().unwrap()
    };
    assert_eq!(document.number, deployment.id);
    assert_eq!(document.calibration.generation, generation);
    assert_eq!(document.calibration.values, values(0.02));
    assert_eq!(
        document.calibration.document_sha256,
        deployment.offer.sha256
    );
    assert_eq!(document.evidence_sha256, revision.hash());
    assert_eq!(
        document.vehicle.unwrap().wheelbase_m.to_bits(),
        1.2_f64.to_bits()
    );
    let requested = document.requested.unwrap();
    assert_eq!(requested.by, proposal.proposed_by);
    let approvers: Vec<_> = document
        .approved
        .iter()
        .map(|act| act.by.as_str())
        .collect();
    assert_eq!(approvers, ["ana", "bruno"]);
    assert_eq!(document.applied.by, "tugger_01");

    bench.approve(0.03, None).await;
    bench.drive_in_verification().await;
    bench.verify(false).await;
    assert_eq!(certificates(&bench).await, kept);
}

#[tokio::test]
async fn a_return_to_earlier_values_is_certified_as_its_person_ordered_it() {
    let bench = Bench::open(Policy::default()).await;
    for offset_rad in [0.02, 0.03] {
        bench.approve(offset_rad, None).await;
        bench.drive_in_verification().await;
        bench.verify(true).await;
    }
    bench.roll_back().await.unwrap();
    bench.drive_in_verification().await;
    bench.verify(true).await;
    let kept = certificates(&bench).await;
    let numbers: Vec<_> = kept.iter().map(|one| one.number).collect();
    assert_eq!(numbers, [3, 2, 1].map(DeploymentId));
    let document = opened(&bench, &kept[0]);
    assert_eq!(document.calibration.values, values(0.02));
    assert_eq!(document.requested, None);
    let ordered = &document.approved[0];
    assert_eq!(
        (ordered.by.as_str(), ordered.reason.as_deref()),
        ("ana", Some("it weaves"))
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_drive_is_the_evidence_of_its_certificate() {
    let bench = Bench::open(Policy::default()).await;
    let mut driver = Driver::new(&bench);
    driver.second(&bench).await;
    bench.propose_values(driver.right_values(), None).await;
    bench.agree().await;
    bench.drive_in_verification().await;
    for _ in 0..240 {
        if !certificates(&bench).await.is_empty() {
            break;
        }
        driver.second(&bench).await;
    }
    let kept = certificates(&bench).await;
    assert_eq!(kept.len(), 1, "after {:.0} m", driver.distance_m);
    let document = opened(&bench, &kept[0]);
    let verification = &document.verification;
    assert!(verification.distance_m >= 60.0, "{verification:?}");
    let limits = verification.limits.unwrap();
    let parts = verification
        .residual
        .fields()
        .zip(verification.sigmas.fields());
    for (((name, residual), (_, sigma)), (_, limit)) in parts.zip(limits.fields()) {
        assert!(
            residual.abs() + 2.0 * sigma <= limit,
            "{name}: {residual} {sigma} {limit}"
        );
    }
    let evidence = verification.evidence.as_ref().unwrap();
    assert!(
        evidence.drive_samples > 1_000 && evidence.scans > 100,
        "{evidence:?}"
    );
    assert!(evidence.nis_mean > 0.0 && evidence.covariance.is_some());
    // On the figure-eight it curves to both sides, and the parts make the whole.
    let motions = evidence.motions.unwrap();
    assert!(
        motions.left_m > 10.0 && motions.right_m > 10.0,
        "{motions:?}"
    );
    let driven_m = motions.left_m + motions.straight_m + motions.right_m;
    assert!((driven_m - evidence.distance_m).abs() < 5.0, "{evidence:?}");
    assert!(kept[0].verified_ns > WallTime(0));
}
