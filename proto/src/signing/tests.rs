use fleetcal_model::{CalibrationCovariance, Generation, RevisionId, RobotTime, WallTime};
use proptest::prelude::*;

use super::*;
use crate::RobotId;
use crate::calibration::{
    Applied, AppliedStatus, CalibrationFrame, CalibrationSchema, CalibrationValues,
};
use crate::offer::{OfferSchema, QUESTION_BYTES, Question};

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
        steering_table: None,
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

/// Makes an envelope around any text, sealed as by [`seal`].
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
    let read = Offered::from_json(&payload).unwrap().envelope;
    assert_eq!(read.open(&trusted()).unwrap(), document());
    let both = TrustedKeys::new(vec![
        SigningKey::from_bytes(&[1; 32]).public_key(),
        key().public_key(),
    ]);
    assert_eq!(read.open(&both.unwrap()).unwrap(), document());
}

fn acknowledgement() -> Applied {
    Applied {
        generation: Generation(4),
        sha256: "ab".to_owned(),
        status: AppliedStatus::Applied,
        reason: None,
        applied_at_ns: RobotTime(7),
        values: None,
    }
}

fn confirmed(signed: Option<Envelope>) -> Confirmed {
    Confirmed {
        generation: Generation(4),
        sha256: "ab".to_owned(),
        signed,
    }
}

#[test]
fn a_confirmation_is_of_one_acknowledgement_alone() {
    let robot = RobotId::parse("tugger_01").unwrap();
    let said = acknowledgement();
    let document = ConfirmationDocument::of(robot, &said);
    let signed = sign(&document, &key()).unwrap();
    assert_eq!(
        signed.document,
        concat!(
            r#"{"schema":"fleetcal.confirmation/1","robot":"tugger_01","generation":4,"#,
            r#""sha256":"ab","status":"applied","applied_at_ns":7}"#
        )
    );
    let text = serde_json::to_string(&confirmed(Some(signed))).unwrap();
    let read: Confirmed = serde_json::from_str(&text).unwrap();
    let opened = read.open(&trusted()).unwrap();
    assert!(opened.confirms(&said));
    let refused = Applied {
        status: AppliedStatus::Refused,
        ..said.clone()
    };
    let later = Applied {
        applied_at_ns: RobotTime(8),
        ..said.clone()
    };
    let other = Applied {
        sha256: "cd".to_owned(),
        ..said.clone()
    };
    let older = Applied {
        generation: Generation(3),
        ..said
    };
    for answer in [refused, later, other, older] {
        assert!(!opened.confirms(&answer), "{answer:?}");
    }
    // Of before: readable, and nobody's word.
    let former: Confirmed = serde_json::from_str(r#"{"generation":4,"sha256":"ab"}"#).unwrap();
    assert_eq!(former, confirmed(None));
    assert_eq!(former.open(&trusted()), Err(EnvelopeRefused::Absent));
}

#[test]
fn an_offer_stands_beside_the_document_and_former_agents_pass_it_over() {
    let envelope = seal(&document(), &key()).unwrap();
    let question = Question::from_bytes([0xa5; QUESTION_BYTES]);
    let offer = OfferDocument {
        schema: OfferSchema::V1,
        robot: RobotId::parse("tugger_01").unwrap(),
        generation: Generation(4),
        sha256: envelope.sha256.clone(),
        offered_at_ns: WallTime(1),
        valid_until_ns: WallTime(2),
        question: Some(question.clone()),
    };
    let offered = Offered {
        envelope: envelope.clone(),
        offer: Some(sign(&offer, &key()).unwrap()),
    };
    let text = serde_json::to_vec(&offered).unwrap();
    let read = Offered::from_json(&text).unwrap();
    assert_eq!(read.open_offer(&trusted()).unwrap(), offer);
    assert_eq!(question.as_str(), "a5".repeat(QUESTION_BYTES));
    let former: Envelope = serde_json::from_slice(&text).unwrap();
    assert_eq!(former, envelope);
    let without = Offered::from(envelope);
    assert_eq!(without.open_offer(&trusted()), Err(EnvelopeRefused::Absent));
    for text in ["", "a5", &"A5".repeat(16), &"a".repeat(33), &"g".repeat(32)] {
        assert!(Question::parse(text).is_err(), "{text:?}");
        let json = serde_json::to_string(text).unwrap();
        assert!(serde_json::from_str::<Question>(&json).is_err());
    }
}

/// Checks that neither a document, a confirmation nor an offer passes for another, though one key
/// signs them all.
#[test]
fn no_kind_of_signed_text_passes_for_another() {
    let robot = RobotId::parse("tugger_01").unwrap();
    let document = seal(&document(), &key()).unwrap();
    let confirmation = ConfirmationDocument::of(robot, &acknowledgement());
    let confirmation = sign(&confirmation, &key()).unwrap();
    let sentence = confirmed(Some(document.clone()))
        .open(&trusted())
        .unwrap_err();
    assert_eq!(
        sentence.to_string(),
        "schema: got \"fleetcal.calibration/1\", expected \"fleetcal.confirmation/1\""
    );
    let offered = Offered {
        envelope: document,
        offer: Some(confirmation.clone()),
    };
    let refused = offered.open_offer(&trusted());
    assert!(matches!(refused, Err(EnvelopeRefused::Schema { .. })));
    let refused = confirmation.open(&trusted());
    assert!(matches!(refused, Err(EnvelopeRefused::Schema { .. })));
}

/// Checks the vectors of RFC 8032, section 7.1, test 1.
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
    let large = Offered::from_json(&vec![b' '; OFFERED_BYTES_MAX + 1]).unwrap_err();
    assert_eq!(
        large,
        EnvelopeRefused::TooLarge {
            length: OFFERED_BYTES_MAX + 1
        }
    );
    let form = Offered::from_json(b"{}").unwrap_err().to_string();
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
        if let Ok(offered) = Offered::from_json(&payload) {
            prop_assert!(offered.envelope.open(&trusted()).is_err());
        }
    }
}
