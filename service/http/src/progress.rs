//! Progress of a connection: whether the service or its peer is waited for, and since when.

use std::io;
use std::pin::Pin;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use axum::body::{Body, Bytes};
use fleetcal_clock::SharedClock;
use fleetcal_domain::limits;
use hyper::body::{Body as HttpBody, Frame, SizeHint};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;

/// Phase of a connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// The next request is awaited, and nothing of it has come.
    Idle,
    /// The rest of a request's header is awaited.
    Header,
    /// A request's body is awaited.
    Body,
    /// A request is being answered.
    Answering,
}

/// Reason for which a connection was cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Overdue {
    /// The next request did not come.
    Idle,
    /// A header began and did not end.
    Header,
    /// The body did not come whole.
    Body,
    /// The answer was not read.
    Write,
}

/// Counter of one address's connections that wait for their peer.
#[derive(Debug, Clone, Default)]
pub(crate) struct Waiting(Arc<AtomicUsize>);

impl Waiting {
    /// Returns the count.
    pub(crate) fn count(&self) -> usize {
        self.0.load(Ordering::Relaxed)
    }

    fn change(&self, waited: bool, waits: bool) {
        match (waited, waits) {
            (false, true) => {
                self.0.fetch_add(1, Ordering::Relaxed);
            }
            (true, false) => {
                self.0.fetch_sub(1, Ordering::Relaxed);
            }
            (false, false) | (true, true) => {}
        }
    }
}

#[derive(Debug)]
struct State {
    phase: Phase,
    /// Start of the phase; for a header, start of the wait for it.
    since: Duration,
    /// Time that the service waited for the peer before this phase, since the peer last did its
    /// part.
    waited: Duration,
    /// Time at which the peer stopped reading the response; `None` while it reads.
    stalled: Option<Duration>,
    /// Longest pause that the peer may make.
    patience: Duration,
    /// Counter of waiting connections; `None` once it has lost its place.
    waiting: Option<Waiting>,
}

impl State {
    /// Returns the time since which the service waits for the peer; `None` while it is its own
    /// turn.
    fn waits_since(&self) -> Option<Duration> {
        let for_request = (self.phase != Phase::Answering).then_some(self.since);
        self.stalled.or(for_request)
    }

    /// Returns the total time that the service has waited for the peer. Only the peer's actions
    /// reset it, or it could be late with one part after the other.
    fn waited_in_all(&self, now: Duration) -> Duration {
        let waits = self.waits_since().map(|since| now.saturating_sub(since));
        self.waited + waits.unwrap_or_default()
    }
}

/// Progress of one connection. All times are of the service's running clock.
#[derive(Debug)]
pub struct Progress {
    clock: SharedClock,
    state: Mutex<State>,
}

/// Patience with the readers of a response that is written piece by piece: the longest pause. It
/// goes into the response's extensions.
#[derive(Debug, Clone, Copy)]
pub struct WritePatience(pub Duration);

impl Progress {
    /// Makes the progress of a new connection, which is counted in `waiting` while it waits.
    pub(crate) fn new(clock: SharedClock, waiting: Waiting) -> Arc<Self> {
        waiting.change(false, true);
        let state = Mutex::new(State {
            phase: Phase::Idle,
            since: clock.elapsed(),
            waited: Duration::ZERO,
            stalled: None,
            patience: limits::HTTP_WRITE_STALL_TIMEOUT,
            waiting: Some(waiting),
        });
        Arc::new(Self { clock, state })
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the state, and with it the count of waiting connections.
    fn change(&self, change: impl FnOnce(&mut State)) {
        let mut state = self.state();
        let waited = state.waits_since().is_some();
        change(&mut state);
        if let Some(waiting) = &state.waiting {
            waiting.change(waited, state.waits_since().is_some());
        }
    }

    fn enter(&self, phase: Phase) {
        let now = self.clock.elapsed();
        self.change(|state| {
            // A stall is counted by itself.
            if state.phase != Phase::Answering && state.stalled.is_none() {
                state.waited += now.saturating_sub(state.since);
            }
            (state.phase, state.since) = (phase, now);
        });
    }

    /// Records that the connection has lost its place and no longer counts.
    pub(crate) fn leave(&self) {
        let mut state = self.state();
        let waited = state.waits_since().is_some();
        if let Some(waiting) = state.waiting.take() {
            waiting.change(waited, false);
        }
    }

    /// Records received bytes of a request. Its header has the remaining time.
    fn received(&self) {
        let mut state = self.state();
        if state.phase == Phase::Idle {
            state.phase = Phase::Header;
            // It asks again, so it has what was answered before.
            if state.stalled.is_none() {
                state.waited = Duration::ZERO;
            }
        }
    }

    /// Records that a request has begun, with or without an awaited body.
    pub(crate) fn request_begins(&self, body_awaited: bool) {
        self.enter(if body_awaited {
            Phase::Body
        } else {
            Phase::Answering
        });
    }

    /// Sets the longest pause of the peer while it reads the present response.
    pub(crate) fn be_patient(&self, patience: Duration) {
        self.state().patience = patience;
    }

    /// Records that the response was handed over whole: the next request may come.
    pub(crate) fn request_ends(&self) {
        self.enter(Phase::Idle);
        self.be_patient(limits::HTTP_WRITE_STALL_TIMEOUT);
    }

    /// Returns the time since which the service waits for the peer; `None` while it is its own
    /// turn.
    pub(crate) fn waits_since(&self) -> Option<Duration> {
        self.state().waits_since()
    }

    /// Returns the peer's failure when a header did not come in time.
    pub(crate) fn header_overdue(&self) -> Overdue {
        match self.state().phase {
            Phase::Idle => Overdue::Idle,
            Phase::Header | Phase::Body | Phase::Answering => Overdue::Header,
        }
    }

    /// Returns the peer's failure to do its part in time, if any.
    pub(crate) fn overdue(&self) -> Option<Overdue> {
        let now = self.clock.elapsed();
        let state = self.state();
        let waits = now.saturating_sub(state.waits_since()?);
        let too_late = state.waited_in_all(now) >= limits::HTTP_PEER_TIMEOUT;
        let (is_over, overdue) = match (state.stalled, state.phase) {
            // Who may pause for longer may do so after any request.
            (Some(_), _) => {
                let is_usual = state.patience <= limits::HTTP_WRITE_STALL_TIMEOUT;
                (
                    waits >= state.patience || is_usual && too_late,
                    Overdue::Write,
                )
            }
            (None, Phase::Idle) => (waits >= limits::HTTP_HEADER_TIMEOUT, Overdue::Idle),
            (None, Phase::Header) => (waits >= limits::HTTP_HEADER_TIMEOUT, Overdue::Header),
            // The route itself answers first, unless it does not read the body.
            (None, Phase::Body) => (
                waits >= limits::HTTP_BODY_TIMEOUT || too_late,
                Overdue::Body,
            ),
            (None, Phase::Answering) => return None,
        };
        is_over.then_some(overdue)
    }

    /// Records the outcome of a write.
    fn note<T>(&self, written: &Poll<io::Result<T>>) {
        let stalls = written.is_pending();
        self.change(|state| {
            if stalls != state.stalled.is_some() {
                state.stalled = stalls.then(|| self.clock.elapsed());
                if !stalls {
                    state.waited = Duration::ZERO;
                }
            }
        });
    }
}

/// Socket that records when its peer stops reading. Unread data of such a peer are discarded with
/// the socket; the system would keep them for minutes.
#[derive(Debug)]
pub struct Watched {
    socket: TcpStream,
    progress: Arc<Progress>,
}

impl Watched {
    /// Wraps a socket and records the outcomes of writes in `progress`.
    pub(crate) fn new(socket: TcpStream, progress: Arc<Progress>) -> Self {
        Self { socket, progress }
    }
}

impl Drop for Watched {
    fn drop(&mut self) {
        let stalls = self.progress.state().stalled.is_some();
        if stalls && let Err(error) = self.socket.set_zero_linger() {
            tracing::debug!(%error, "what a peer has not read stays with the system");
        }
    }
}

impl AsyncRead for Watched {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        let read = Pin::new(&mut self.socket).poll_read(context, buffer);
        if buffer.filled().len() > before {
            self.progress.received();
        }
        read
    }
}

impl AsyncWrite for Watched {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.socket).poll_write(context, bytes);
        self.progress.note(&written);
        written
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        pieces: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.socket).poll_write_vectored(context, pieces);
        self.progress.note(&written);
        written
    }

    fn is_write_vectored(&self) -> bool {
        self.socket.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.socket).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.socket).poll_shutdown(context)
    }
}

/// Body with a guard that lasts as long as it is read or written.
pub struct Held<B, G> {
    body: B,
    _guard: G,
}

impl<B, G> Held<B, G>
where
    B: HttpBody<Data = Bytes> + Unpin + Send + 'static,
    B::Error: Into<axum::BoxError>,
    G: Unpin + Send + 'static,
{
    /// Makes a body that drops `guard` when it is dropped itself.
    pub(crate) fn body(body: B, guard: G) -> Body {
        Body::new(Self {
            body,
            _guard: guard,
        })
    }
}

impl<B: HttpBody + Unpin, G: Unpin> HttpBody for Held<B, G> {
    type Data = B::Data;
    type Error = B::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<B::Data>, B::Error>>> {
        Pin::new(&mut self.body).poll_frame(context)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

/// Request body; dropping it ends the body timeout.
pub struct BodyAwaited(pub Arc<Progress>);

impl Drop for BodyAwaited {
    fn drop(&mut self) {
        self.0.enter(Phase::Answering);
    }
}

#[cfg(test)]
mod tests {
    use fleetcal_clock::{Clock, MockClock};
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    use tokio::net::TcpListener;

    use super::*;

    /// Length beyond the system's buffers, bytes.
    const LONG: usize = 32 << 20;

    #[tokio::test]
    async fn a_peer_that_does_not_read_is_overdue_until_it_reads() {
        let clock = MockClock::at(0);
        let progress = Progress::new(clock.clone(), Waiting::default());
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let mut peer = TcpStream::connect(listener.local_addr().unwrap())
            .await
            .unwrap();
        let (socket, _) = listener.accept().await.unwrap();
        let mut watched = Watched::new(socket, Arc::clone(&progress));
        progress.request_begins(false);
        assert_eq!((progress.waits_since(), progress.overdue()), (None, None));
        let writing = tokio::spawn(async move { watched.write_all(&vec![0; LONG]).await });
        while progress.waits_since().is_none() {
            tokio::task::yield_now().await;
        }
        assert_eq!(progress.waits_since(), Some(Duration::ZERO));
        clock.advance(limits::HTTP_WRITE_STALL_TIMEOUT);
        assert_eq!(progress.overdue(), Some(Overdue::Write));
        progress.be_patient(2 * limits::HTTP_WRITE_STALL_TIMEOUT);
        assert_eq!(progress.overdue(), None);
        peer.read_exact(&mut vec![0; LONG]).await.unwrap();
        writing.await.unwrap().unwrap();
        assert_eq!(progress.waits_since(), None);
    }

    #[test]
    fn a_header_and_a_body_have_their_time() {
        let clock = MockClock::at(0);
        let progress = Progress::new(clock.clone(), Waiting::default());
        clock.advance(limits::HTTP_HEADER_TIMEOUT);
        assert_eq!(progress.overdue(), Some(Overdue::Idle));
        // A header that began late gets no time of its own, or it could be sent for ever.
        progress.received();
        assert_eq!(progress.overdue(), Some(Overdue::Header));
        progress.request_begins(true);
        assert_eq!(progress.overdue(), None);
        clock.advance(limits::HTTP_BODY_TIMEOUT);
        assert_eq!(progress.overdue(), Some(Overdue::Body));
        drop(BodyAwaited(Arc::clone(&progress)));
        assert_eq!((progress.waits_since(), progress.overdue()), (None, None));
        progress.request_ends();
        assert_eq!(progress.waits_since(), Some(clock.elapsed()));
    }

    #[test]
    fn a_peer_that_is_late_with_one_part_after_the_other_has_one_time_for_all() {
        let idle = limits::HTTP_HEADER_TIMEOUT.mul_f64(0.9);
        let left = limits::HTTP_PEER_TIMEOUT.saturating_sub(idle);
        let moment = Duration::from_millis(1);
        let stall = Poll::<io::Result<()>>::Pending;
        let late = |body_awaited| {
            let clock = MockClock::at(0);
            let progress = Progress::new(clock.clone(), Waiting::default());
            clock.advance(idle);
            progress.received();
            progress.request_begins(body_awaited);
            (clock, progress)
        };
        // A body that does not come.
        let (clock, progress) = late(true);
        clock.advance(left.saturating_sub(moment));
        assert_eq!(progress.overdue(), None);
        clock.advance(moment);
        assert_eq!(progress.overdue(), Some(Overdue::Body));
        // Answers to many requests at once, of which the system takes the first and none is read.
        let (clock, progress) = late(false);
        progress.request_ends();
        progress.request_begins(false);
        progress.note(&stall);
        clock.advance(left.saturating_sub(moment));
        assert_eq!(progress.overdue(), None);
        clock.advance(moment);
        assert_eq!(progress.overdue(), Some(Overdue::Write));
        // Who reads in between, or asks again, has done its part.
        progress.note(&Poll::Ready(Ok(())));
        progress.note(&stall);
        clock.advance(left);
        assert_eq!(progress.overdue(), None);
        progress.note(&Poll::Ready(Ok(())));
        progress.request_ends();
        clock.advance(idle);
        progress.received();
        progress.request_begins(true);
        assert_eq!(progress.overdue(), None);
    }

    #[test]
    fn an_address_counts_what_waits_for_its_peer() {
        let clock = MockClock::at(0);
        let waiting = Waiting::default();
        let [first, second] = [(), ()].map(|()| Progress::new(clock.clone(), waiting.clone()));
        assert_eq!(waiting.count(), 2);
        first.request_begins(true);
        assert_eq!(waiting.count(), 2, "its body is awaited");
        first.enter(Phase::Answering);
        assert_eq!(waiting.count(), 1);
        first.note(&Poll::<io::Result<()>>::Pending);
        assert_eq!(waiting.count(), 2, "its answer is not read");
        first.note(&Poll::Ready(Ok(())));
        second.leave();
        assert_eq!(waiting.count(), 0);
        second.request_begins(false);
        second.request_ends();
        first.leave();
        assert_eq!(waiting.count(), 0, "what has left counts no more");
    }
}
