//! Signatures of messages by the Standard Webhooks scheme.

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use hmac::{Hmac, Mac};
use sha2::Sha256;

/// Prefix of a secret's text.
const PREFIX: &str = "whsec_";
/// Hexadecimal digits of a message's id.
const ID_DIGITS: usize = 24;

/// Secret that signs a webhook's messages. It is stored in plain form, because both sides sign with
/// it; it is shown once, and never printed.
#[derive(Clone, PartialEq, Eq)]
pub struct Secret(Vec<u8>);

impl std::fmt::Debug for Secret {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("Secret(..)")
    }
}

impl Secret {
    /// Makes a secret of these bytes, of which the scheme accepts 24 to 64.
    pub fn from_bytes(bytes: Vec<u8>) -> Self {
        Self(bytes)
    }

    /// Bytes to be stored.
    pub fn as_bytes(&self) -> &[u8] {
        &self.0
    }

    /// Text for the receiver: `whsec_` and base64.
    pub fn to_text(&self) -> String {
        format!("{PREFIX}{}", BASE64_STANDARD.encode(&self.0))
    }

    /// Signature for the header `webhook-signature`: HMAC-SHA256 over `id.timestamp.body`, the time
    /// in seconds since 1970.
    pub fn sign(&self, id: &str, timestamp_s: i64, body: &str) -> String {
        let code = self.code(&[id, ".", &timestamp_s.to_string(), ".", body]);
        format!("v1,{}", BASE64_STANDARD.encode(code))
    }

    /// Identifier for the header `webhook-id` of a message about `subject`: the same for each
    /// attempt, and another one for every webhook.
    pub fn message_id(&self, subject: &str) -> String {
        let code = self.code(&["webhook-id ", subject]);
        let digits: String = hex::encode(code).chars().take(ID_DIGITS).collect();
        format!("msg_{digits}")
    }

    fn code(&self, parts: &[&str]) -> Vec<u8> {
        #[expect(clippy::expect_used, reason = "HMAC takes a key of any length")]
        let mut hmac = Hmac::<Sha256>::new_from_slice(&self.0).expect("a key of any length");
        for part in parts {
            hmac.update(part.as_bytes());
        }
        hmac.finalize().into_bytes().to_vec()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_signature_is_that_of_the_schemes_own_example() {
        let bytes = BASE64_STANDARD.decode("MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw");
        let secret = Secret::from_bytes(bytes.unwrap());
        assert_eq!(secret.to_text(), "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw");
        let signature = secret.sign(
            "msg_p5jXN8AQM9LWM0D4loKWxJek",
            1_614_265_330,
            r#"{"test": 2432232314}"#,
        );
        assert_eq!(signature, "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE=");
    }

    #[test]
    fn a_message_keeps_its_id_and_a_secret_its_secret() {
        let one = Secret::from_bytes(vec![1; 32]);
        let other = Secret::from_bytes(vec![2; 32]);
        let id = one.message_id("alert-17-3");
        assert_eq!(id, one.message_id("alert-17-3"));
        assert_ne!(id, one.message_id("alert-17-4"));
        assert_ne!(id, other.message_id("alert-17-3"));
        assert_eq!(id.len(), "msg_".len() + ID_DIGITS);
        assert_eq!(format!("{one:?}"), "Secret(..)");
    }
}
