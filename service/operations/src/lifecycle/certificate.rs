//! Certificate of a verified calibration, made in the transaction of its verification: no
//! calibration is verified without one, whatever ends the process.

use fleetcal_certificate::Verified;
use fleetcal_domain::approval::{Deployment, DeploymentAction, Outcome, Refused, Transition};
use fleetcal_proto::signing::sign;
use fleetcal_store::{CertificateRecord, Records, StoreError};

use super::Decide;

impl Decide {
    /// Certificate of the deployment that an outcome verifies, if it verifies one.
    pub(super) async fn certificate(
        &self,
        records: &mut dyn Records,
        outcome: &Outcome,
    ) -> Result<Option<CertificateRecord>, StoreError> {
        let Some(deployment) = outcome.transitions.iter().find_map(verified) else {
            return Ok(None);
        };
        let revision = outcome.ledger.revisions.get(&deployment.offer.revision);
        let (Some(revision), Some(verification)) = (revision, &deployment.verification) else {
            return Err(StoreError::Corrupt {
                table: "deployment",
                reason: format!("{} lacks its revision or verdict", deployment.id),
            });
        };
        let proposal = match deployment.proposal {
            Some(id) => records.proposal(id).await?,
            None => None,
        };
        let robot = records.robot(&self.robot).await?;
        let document = fleetcal_certificate::certificate(&Verified {
            deployment,
            verification,
            revision,
            proposal: proposal.as_ref(),
            vehicle: robot.as_ref().and_then(|robot| robot.config.as_ref()),
            cross_tracks: &self.cross_tracks,
        });
        let envelope = sign(&document, &self.key);
        let envelope = envelope.map_err(|error| Refused::Seal(error.to_string()))?;
        Ok(Some(CertificateRecord {
            number: deployment.id,
            robot: deployment.robot.clone(),
            verified_ns: verification.at_ns,
            approved_by: deployment.approved_by.clone(),
            envelope,
        }))
    }
}

/// Deployment that a transition verifies.
fn verified(transition: &Transition) -> Option<&Deployment> {
    match transition {
        Transition::Deployment(change) if change.action == DeploymentAction::Verify => {
            Some(&change.after)
        }
        _ => None,
    }
}
