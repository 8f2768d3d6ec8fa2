//! Answers already given to requests with an `Idempotency-Key`.

use async_trait::async_trait;
use fleetcal_model::{RobotId, WallTime};

use crate::error::StoreError;
use crate::record::IdempotencyKey;

/// Among which requests a key is one of a kind, and what the request made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnswerScope<'a> {
    /// Notes about this robot: an event.
    Event(&'a RobotId),
    /// Proposals for this robot: a proposal.
    Proposal(&'a RobotId),
    /// New users: a user.
    User,
    /// New tokens: a token.
    Token,
}

/// An answer already given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Answer {
    /// SHA-256 of the request's body.
    pub request_sha256: [u8; 32],
    /// The number of what it made.
    pub made: i64,
}

/// Answers already given; errors as in [`super::Records`].
#[async_trait]
pub trait AnswerRecords {
    /// The answer given to a request with this key.
    async fn answer(
        &mut self,
        scope: AnswerScope<'_>,
        key: &str,
    ) -> Result<Option<Answer>, StoreError>;

    /// Keeps what a request has made.
    async fn add_answer(
        &mut self,
        scope: AnswerScope<'_>,
        key: &IdempotencyKey,
        made: i64,
        now: WallTime,
    ) -> Result<(), StoreError>;
}
