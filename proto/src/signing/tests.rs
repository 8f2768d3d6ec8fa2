use fleetcal_model::{CalibrationCovariance, Generation, RevisionId};
use proptest::prelude::*;

use super::*;
use crate::RobotId;
use crate::calibration::{CalibrationFrame, CalibrationValues};

fn document() -> CalibrationDocument {
    CalibrationDocument {
        schema: CalibrationSchema::V1,
        robot: RobotId::parse("tugger_01").unwrap(),
        generation: Generation(4),
        base_generation: Some(Generation(3)),
        revision: RevisionId(17),
        approved_at: "2026-11-21T12:00:00Z".to_owned(),
        approved_by: "ana".to_owned(),
        values: CalibrationValues {
            steering_offset_rad: 0.051,
            lidar_x_m: 0.434,
            lidar_y_m: -0.016,
            lidar_yaw_rad: 0.0133,
            speed_scale: Some(1.002),
            ..CalibrationValues::default()
        },
        sigmas: CalibrationValues::default(),
        covariance: None,
        frame: CalibrationFrame::RearAxle,
        confirm_within_s: 600,
        rear_axle_in_base_link: None,
        lidar_in_base_link: None,
    }
}

fn key() -> SigningKey {
    SigningKey::from_bytes(&[7; KEY_BYTES])
}

fn trusted() -> TrustedKeys {
    key().public_key().into()
}

/// An envelope around any text, sealed as [`seal`] does it.
fn sealed_text(document: &str) -> Envelope {
    Envelope {
        document: document.to_owned(),
        sha256: sha256_hex(document.as_bytes()),
        key_id: key().public_key().id(),
        signature: BASE64.encode(key().0.sign(document.as_bytes()).to_bytes()),
    }
}

#[test]
fn what_is_sealed_opens_to_the_same_document() {
    let envelope = seal(&document(), &key()).unwrap();
    let payload = serde_json::to_vec(&envelope).unwrap();
    let read = Envelope::from_json(&payload).unwrap();
    assert_eq!(read.open(&trusted()).unwrap(), document());
    let both = TrustedKeys::new(vec![
        SigningKey::from_bytes(&[1; 32]).public_key(),
        key().public_key(),
    ]);
    assert_eq!(read.open(&both.unwrap()).unwrap(), document());
}

/// RFC 8032, section 7.1, test 1.
#[test]
fn keys_and_signatures_are_those_of_the_standard() {
    let bytes = |hex: &str| -> Vec<u8> {
        let pairs = (0..hex.len()).step_by(2);
        pairs
            .map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap())
            .collect()
    };
    let secret = bytes("9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60");
    let public = bytes("d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a");
    let signature = bytes(concat!(
        "e5564300c360ac729086e2cc806e828a84877f1eb8e5d974d873e065224901555fb8821590a33bac",
        "c61e39701cf9b46bd25bf5f0595bbe24655141438e7a100b"
    ));
    let key = SigningKey::from_bytes(&secret.try_into().unwrap());
    assert_eq!(key.public_key().to_string(), BASE64.encode(&public));
    assert_eq!(key.public_key().id(), sha256_hex(&public)[..16]);
    assert_eq!(key.0.sign(b"").to_bytes().to_vec(), signature);
    let text = key.public_key().to_string();
    assert_eq!(text.parse::<PublicKey>().unwrap(), key.public_key());
    assert_eq!(
        format!("{text}\n").parse::<PublicKey>().unwrap(),
        key.public_key()
    );
}

#[test]
fn each_check_refuses_with_what_it_found() {
    let good = seal(&document(), &key()).unwrap();
    let text = good.document.clone();
    let other_key = SigningKey::from_bytes(&[8; KEY_BYTES]);
    let cases = [
        (
            Envelope {
                sha256: "ab".to_owned(),
                ..good.clone()
            },
            "sha256 is ab, the document's is",
        ),
        (seal(&document(), &other_key).unwrap(), "key_id: got"),
        (
            Envelope {
                key_id: good.key_id.clone(),
                ..seal(&document(), &other_key).unwrap()
            },
            "signature: another one",
        ),
        (
            Envelope {
                signature: "%".to_owned(),
                ..good.clone()
            },
            "signature: not base64",
        ),
        (
            Envelope {
                signature: "AAAA".to_owned(),
                ..good.clone()
            },
            "signature: not 64 bytes long",
        ),
        (
            sealed_text(&text.replace("calibration/1", "calibration/2")),
            "schema: got \"fleetcal.calibration/2\"",
        ),
        (sealed_text("{}"), "document: missing field `schema`"),
        (
            sealed_text(&text.replace("0.051", "\"left\"")),
            "document: values.steering_offset_rad: ",
        ),
        (
            sealed_text(&text.replace("0.051", "1e999")),
            "number out of range",
        ),
        (
            sealed_text(&text.replace("tugger_01", "a/b")),
            "document: robot: ",
        ),
        (sealed_text(&format!("{text}{text}")), "trailing characters"),
    ];
    for (envelope, wanted) in cases {
        let sentence = envelope.open(&trusted()).unwrap_err().to_string();
        assert!(
            sentence.contains(wanted),
            "{wanted:?} is not in {sentence:?}"
        );
    }
    let large = Envelope::from_json(&vec![b' '; ENVELOPE_BYTES_MAX + 1]).unwrap_err();
    assert_eq!(
        large,
        EnvelopeRefused::TooLarge {
            length: ENVELOPE_BYTES_MAX + 1
        }
    );
    let form = Envelope::from_json(b"{}").unwrap_err().to_string();
    assert!(form.contains("missing field `document`"), "{form}");
}

#[test]
fn what_nobody_could_read_is_not_sealed() {
    let mut unreal = document();
    unreal.values.speed_scale = Some(f64::NAN);
    let sentence = seal(&unreal, &key()).unwrap_err().to_string();
    assert_eq!(
        sentence,
        "values.speed_scale: got NaN, expected finite numbers"
    );
    let mut long = document();
    long.approved_by = "a".repeat(ENVELOPE_BYTES_MAX);
    assert!(matches!(
        seal(&long, &key()),
        Err(SealRefused::TooLarge { .. })
    ));
}

#[test]
fn keys_that_cannot_be_trusted_are_refused() {
    let weak = BASE64.encode([&[1_u8][..], &[0; 31]].concat());
    let cases = [
        ("?", "not base64"),
        ("AAAA", "not 32 bytes long"),
        (weak.as_str(), "weak"),
    ];
    for (text, wanted) in cases {
        let sentence = text.parse::<PublicKey>().unwrap_err().to_string();
        assert!(sentence.contains(wanted), "{sentence}");
    }
    for count in [0, 9] {
        let keys = vec![key().public_key(); count];
        assert_eq!(TrustedKeys::new(keys), Err(TrustedKeysRefused { count }));
    }
    let shown = format!("{:?}", key());
    assert_eq!(shown, format!("SigningKey({})", key().public_key().id()));
}

fn changed(text: &str, at: prop::sample::Index, to: u8) -> Option<String> {
    let mut bytes = text.as_bytes().to_vec();
    let place = at.index(bytes.len());
    if bytes[place] == to {
        return None;
    }
    bytes[place] = to;
    String::from_utf8(bytes).ok()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn one_changed_byte_anywhere_is_refused(
        field in 0_usize..4, at: prop::sample::Index, to in 0_u8..128,
    ) {
        let mut envelope = seal(&document(), &key()).unwrap();
        let text = match field {
            0 => &mut envelope.document,
            1 => &mut envelope.sha256,
            2 => &mut envelope.key_id,
            _ => &mut envelope.signature,
        };
        let Some(altered) = changed(text, at, to) else { return Ok(()) };
        *text = altered;
        prop_assert!(envelope.open(&trusted()).is_err());
    }

    #[test]
    fn a_document_altered_together_with_its_hash_is_refused_for_its_signature(
        at: prop::sample::Index, to in 0_u8..128,
    ) {
        let mut envelope = seal(&document(), &key()).unwrap();
        let Some(altered) = changed(&envelope.document, at, to) else { return Ok(()) };
        envelope.sha256 = sha256_hex(altered.as_bytes());
        envelope.document = altered;
        let refused = envelope.open(&trusted()).unwrap_err();
        prop_assert!(matches!(refused, EnvelopeRefused::Signature { .. }), "{refused}");
    }

    #[test]
    fn any_values_come_back_bit_for_bit(
        numbers in prop::collection::vec(prop::num::f64::NORMAL | prop::num::f64::ZERO, 5),
        generation: u64, base_generation: Option<u64>, confirm_within_s: u32, approved_by: String,
    ) {
        let mut sent = document();
        sent.values.steering_offset_rad = numbers[0];
        sent.values.lidar_x_m = numbers[1];
        sent.values.time_offset_s = Some(numbers[2]);
        sent.sigmas.lidar_yaw_rad = numbers[3];
        sent.sigmas.wheelbase_m = Some(numbers[4]);
        sent.covariance = Some(CalibrationCovariance::from_fn(|row, column| {
            numbers[(row.index() + column.index()) % numbers.len()]
        }));
        let sent = CalibrationDocument {
            generation: Generation(generation),
            base_generation: base_generation.map(Generation),
            approved_by, confirm_within_s, ..sent
        };
        let opened = seal(&sent, &key()).unwrap().open(&trusted()).unwrap();
        prop_assert_eq!(format!("{opened:?}"), format!("{sent:?}"));
    }

    #[test]
    fn any_bytes_are_read_or_refused(payload in prop::collection::vec(any::<u8>(), 0..200)) {
        if let Ok(envelope) = Envelope::from_json(&payload) {
            prop_assert!(envelope.open(&trusted()).is_err());
        }
    }
}
