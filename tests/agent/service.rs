//! A service's half of the calibration keys, in a router of its own.

use std::sync::{Arc, Mutex};

use fleetcal_model::{Generation, RevisionId, WallTime};
use fleetcal_ports::free_address;
use fleetcal_proto::calibration::{
    Applied, AppliedStatus, CalibrationDocument, CalibrationFrame, CalibrationSchema,
    CalibrationValues, ConfirmationDocument, Confirmed, Envelope,
};
use fleetcal_proto::key::ServiceInstance;
use fleetcal_proto::offer::{OfferDocument, OfferSchema, Offered, Question};
use fleetcal_proto::signing::{SigningKey, seal, sign};
use fleetcal_proto::{Keys, RobotId, StreamKind};
use tokio::sync::mpsc;
use zenoh::liveliness::LivelinessToken;
use zenoh::{Session, Wait};

fn robot() -> RobotId {
    RobotId::parse("tugger_01").unwrap()
}

pub fn key() -> SigningKey {
    SigningKey::from_bytes(&[5; 32])
}

/// Returns the steering offset of a generation, different for each.
pub fn offset_rad(generation: u64) -> f64 {
    1e-4 * generation as f64
}

pub fn approved(generation: u64) -> Envelope {
    let values = CalibrationValues {
        steering_offset_rad: offset_rad(generation),
        lidar_x_m: 0.434,
        lidar_y_m: -0.016,
        lidar_yaw_rad: 0.0133,
        ..CalibrationValues::default()
    };
    let document = CalibrationDocument {
        schema: CalibrationSchema::V1,
        robot: robot(),
        generation: Generation(generation),
        base_generation: generation.checked_sub(1).map(Generation),
        revision: RevisionId(generation),
        approved_at: "2026-11-21T12:00:00Z".to_owned(),
        approved_by: "ana".to_owned(),
        values,
        sigmas: CalibrationValues::default(),
        covariance: None,
        steering_table: None,
        frame: CalibrationFrame::RearAxle,
        confirm_within_s: 600,
        rear_axle_in_base_link: None,
        lidar_in_base_link: None,
    };
    seal(&document, &key()).unwrap()
}

/// Makes the document with the service's offer, in answer to a question.
fn wanted(envelope: &Envelope, question: Option<Question>) -> Offered {
    let document = envelope.open(&key().public_key().into()).unwrap();
    let offer = OfferDocument {
        schema: OfferSchema::V1,
        robot: document.robot,
        generation: document.generation,
        sha256: envelope.sha256.clone(),
        offered_at_ns: WallTime(0),
        valid_until_ns: WallTime(3_600_000_000_000),
        question,
    };
    Offered {
        envelope: envelope.clone(),
        offer: Some(sign(&offer, &key()).unwrap()),
    }
}

#[derive(Default)]
struct Stored {
    approved: Option<Envelope>,
    confirmed: Option<Confirmed>,
    answers: Vec<Applied>,
}

pub struct Service {
    pub endpoint: String,
    session: Session,
    stored: Arc<Mutex<Stored>>,
}

impl Service {
    pub async fn start() -> Self {
        let endpoint = format!("tcp/{}", free_address());
        let mut config = zenoh::Config::default();
        for (name, value) in [
            ("mode", "\"router\"".to_owned()),
            ("listen/endpoints", format!("[\"{endpoint}\"]")),
            ("scouting/multicast/enabled", "false".to_owned()),
        ] {
            config.insert_json5(name, &value).unwrap();
        }
        let service = Self {
            endpoint,
            session: zenoh::open(config).await.unwrap(),
            stored: Arc::default(),
        };
        service.listen().await;
        let document = |stored: &Stored, question| {
            let offered = wanted(stored.approved.as_ref()?, question);
            serde_json::to_vec(&offered).ok()
        };
        let confirmed = |stored: &Stored, _| serde_json::to_vec(stored.confirmed.as_ref()?).ok();
        service
            .answer(StreamKind::CalibrationApproved, document)
            .await;
        service
            .answer(StreamKind::CalibrationConfirmed, confirmed)
            .await;
        service
    }

    pub async fn approve(&self, envelope: &Envelope) {
        self.stored.lock().unwrap().approved = Some(envelope.clone());
        let key = Keys::default().stream(&robot(), StreamKind::CalibrationApproved);
        let payload = serde_json::to_vec(&wanted(envelope, None)).unwrap();
        self.session.put(key, payload).await.unwrap();
    }

    /// Shows the token of a running service, until it is dropped.
    pub async fn token(&self) -> LivelinessToken {
        let token = Keys::default().service(&ServiceInstance::parse("a1").unwrap());
        let declared = self.session.liveliness().declare_token(token).await;
        declared.unwrap()
    }

    pub fn answers(&self) -> Vec<Applied> {
        self.stored.lock().unwrap().answers.clone()
    }

    pub fn has_applied(&self, generation: u64) -> bool {
        let applied = AppliedStatus::Applied;
        let answers = self.answers();
        let mut about_it = answers
            .iter()
            .filter(|answer| answer.generation == Generation(generation));
        about_it.any(|answer| answer.status == applied)
    }

    /// Asserts that each acknowledgement names the approved document and the values in use.
    pub fn assert_every_answer_is_true(&self) {
        for answer in self.answers() {
            assert_eq!(answer.status, AppliedStatus::Applied, "{answer:?}");
            assert_eq!(answer.sha256, approved(answer.generation.0).sha256);
            let values = answer.values.unwrap();
            assert_eq!(
                values.steering_offset_rad.to_bits(),
                offset_rad(answer.generation.0).to_bits()
            );
        }
    }

    async fn answer(
        &self,
        kind: StreamKind,
        payload: fn(&Stored, Option<Question>) -> Option<Vec<u8>>,
    ) {
        let stored = Arc::clone(&self.stored);
        let key = Keys::default().stream(&robot(), kind);
        let queryable = self.session.declare_queryable(key.clone());
        let answering = queryable.complete(true).callback(move |query| {
            let asked = query.payload().and_then(|text| text.try_to_string().ok());
            let question = asked.and_then(|text| Question::parse(&text).ok());
            if let Some(payload) = payload(&stored.lock().unwrap(), question) {
                query.reply(&key, payload).wait().unwrap();
            }
        });
        answering.background().await.unwrap();
    }

    /// Stores every acknowledgement, and confirms it afterwards.
    async fn listen(&self) {
        let (sender, mut to_confirm) = mpsc::channel::<Confirmed>(64);
        let stored = Arc::clone(&self.stored);
        let applied = Keys::default().stream(&robot(), StreamKind::CalibrationApplied);
        let subscriber = self
            .session
            .declare_subscriber(applied)
            .callback(move |sample| {
                let answer: Applied = serde_json::from_slice(&sample.payload().to_bytes()).unwrap();
                let document = ConfirmationDocument::of(robot(), &answer);
                let confirmed = Confirmed {
                    generation: answer.generation,
                    sha256: answer.sha256.clone(),
                    signed: Some(sign(&document, &self::key()).unwrap()),
                };
                let mut stored = stored.lock().unwrap();
                stored.answers.push(answer);
                stored.confirmed = Some(confirmed.clone());
                sender.try_send(confirmed).unwrap();
            });
        subscriber.background().await.unwrap();
        let session = self.session.clone();
        tokio::spawn(async move {
            let key = Keys::default().stream(&robot(), StreamKind::CalibrationConfirmed);
            while let Some(confirmed) = to_confirm.recv().await {
                let payload = serde_json::to_vec(&confirmed).unwrap();
                session.put(&key, payload).await.unwrap();
            }
        });
    }
}
