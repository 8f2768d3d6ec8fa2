//! Requests for certificates.

use fleetcal_model::DeploymentId;

use crate::Store;
use crate::certificates::{CertificateFilter, CertificateRecord};
use crate::error::StoreError;

impl Store {
    /// Certificates, newest first.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn certificates(
        &self,
        filter: &CertificateFilter,
    ) -> Result<Vec<CertificateRecord>, StoreError> {
        self.shared.reader.certificates(filter).await
    }

    /// Reads one certificate.
    ///
    /// # Errors
    /// The database's failure.
    pub async fn certificate(
        &self,
        number: DeploymentId,
    ) -> Result<Option<CertificateRecord>, StoreError> {
        self.shared.reader.certificate(number).await
    }
}
