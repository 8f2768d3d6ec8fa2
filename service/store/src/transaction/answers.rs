//! Answers already given to requests with an `Idempotency-Key`.

use async_trait::async_trait;
use fleetcal_model::{RobotId, WallTime};

use crate::error::StoreError;
use crate::record::IdempotencyKey;

/// Scope in which an idempotency key is unique, and the kind of record that its request created.
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

/// Answer already given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Answer {
    /// SHA-256 of the request's body.
    pub request_sha256: [u8; 32],
    /// Number of the created record.
    pub made: i64,
}

/// Answers already given; errors as in [`super::Records`].
#[async_trait]
pub trait AnswerRecords {
    /// Finds the answer given to a request with this key.
    async fn answer(
        &mut self,
        scope: AnswerScope<'_>,
        key: &str,
    ) -> Result<Option<Answer>, StoreError>;

    /// Stores the record that a request created.
    async fn add_answer(
        &mut self,
        scope: AnswerScope<'_>,
        key: &IdempotencyKey,
        made: i64,
        now: WallTime,
    ) -> Result<(), StoreError>;
}
