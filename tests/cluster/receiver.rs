//! A webhook receiver that answers slowly, refuses every third message once and records all.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use serde_json::Value;

use crate::checker::{Decision, Outcome};

/// Delay of an answer: a sender that is killed is mostly killed meanwhile.
const ANSWERS_AFTER: Duration = Duration::from_millis(400);
/// Number of messages of which one is refused the first time.
const REFUSES_ONE_OF: usize = 3;

/// A received message.
#[derive(Debug, Clone)]
struct Message {
    id: String,
    body: String,
    is_taken: bool,
}

/// Webhook receiver; see the module.
#[derive(Debug)]
pub struct Receiver {
    address: SocketAddr,
    came: Arc<Mutex<Vec<Message>>>,
    accepts: Arc<AtomicBool>,
}

impl Receiver {
    /// Listens on a loopback port until the test ends.
    pub fn start() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let came = Arc::<Mutex<Vec<Message>>>::default();
        let accepts = Arc::<AtomicBool>::default();
        let (list, is_accepting) = (Arc::clone(&came), Arc::clone(&accepts));
        std::thread::spawn(move || {
            for connection in listener.incoming().flatten() {
                let Some((id, body)) = request(&connection) else {
                    continue;
                };
                let is_taken = {
                    let all = list.lock().unwrap();
                    let is_first = all.iter().all(|message: &Message| message.id != id);
                    !is_first || (all.len() + 1) % REFUSES_ONE_OF != 0
                };
                is_accepting.store(is_taken, Ordering::Relaxed);
                std::thread::sleep(ANSWERS_AFTER);
                is_accepting.store(false, Ordering::Relaxed);
                list.lock().unwrap().push(Message { id, body, is_taken });
                answer(&connection, is_taken);
            }
        });
        Self {
            address,
            came,
            accepts,
        }
    }

    /// True if it is about to accept a message: a sender that is killed now never learns of it.
    pub fn is_accepting(&self) -> bool {
        self.accepts.load(Ordering::Relaxed)
    }

    /// Returns the URL for messages.
    pub fn url(&self) -> String {
        format!("http://{}/told", self.address)
    }

    /// Returns the acknowledged proposals among decisions without an accepted message, by their
    /// reasons.
    pub fn not_told(&self, decisions: &[Decision]) -> Vec<String> {
        let came = self.came.lock().unwrap();
        let taken = came.iter().filter(|message| message.is_taken);
        let told: BTreeSet<_> = taken.filter_map(|message| reason(&message.body)).collect();
        let reasons = proposed(decisions);
        reasons.filter(|reason| !told.contains(reason)).collect()
    }

    /// Asserts that each message has one text, and each proposal one message; returns the number of
    /// messages, and of those repeated after they had been accepted.
    pub fn counts(&self) -> [usize; 2] {
        let came = self.came.lock().unwrap();
        let (mut texts, mut ids) = (BTreeMap::new(), BTreeMap::new());
        let (mut taken, mut again) = (BTreeSet::new(), 0);
        for Message { id, body, is_taken } in came.iter() {
            assert_eq!(texts.entry(id).or_insert(body), &body, "{id} has two texts");
            if let Some(reason) = reason(body) {
                assert_eq!(
                    ids.entry(reason).or_insert(id),
                    &id,
                    "a proposal has two messages"
                );
            }
            again += usize::from(taken.contains(id));
            if *is_taken {
                taken.insert(id);
            }
        }
        [came.len(), again]
    }
}

/// Returns the reasons of the acknowledged proposals among decisions.
pub fn proposed(decisions: &[Decision]) -> impl Iterator<Item = String> {
    let proposed = decisions
        .iter()
        .filter(|one| one.outcome == Outcome::Acknowledged && one.reason.starts_with("propose "));
    proposed.map(|one| one.reason.clone())
}

/// Returns the reason of the proposal in a message.
fn reason(body: &str) -> Option<String> {
    let body: Value = serde_json::from_str(body).ok()?;
    Some(body["data"]["reason"].as_str()?.to_owned())
}

/// Reads the `webhook-id` and the body of a request; `None` if it breaks off, as a killed sender's
/// does.
fn request(connection: &TcpStream) -> Option<(String, String)> {
    let mut reader = BufReader::new(connection);
    let (mut id, mut length) = (None, 0);
    loop {
        let mut line = String::new();
        if reader.read_line(&mut line).ok()? == 0 {
            return None;
        }
        let Some((name, value)) = line.split_once(':') else {
            if line.trim().is_empty() {
                break;
            }
            continue;
        };
        match name.to_ascii_lowercase().as_str() {
            "webhook-id" => id = Some(value.trim().to_owned()),
            "content-length" => length = value.trim().parse().ok()?,
            _ => {}
        }
    }
    let mut body = vec![0; length];
    reader.read_exact(&mut body).ok()?;
    Some((id?, String::from_utf8(body).ok()?))
}

/// Accepts or refuses a message. A sender that was killed meanwhile does not receive the answer.
fn answer(mut connection: &TcpStream, is_taken: bool) {
    let status = if is_taken {
        "204 No Content"
    } else {
        "503 Service Unavailable"
    };
    let answer = format!("HTTP/1.1 {status}\r\nContent-Length: 0\r\nConnection: close\r\n\r\n");
    drop(connection.write_all(answer.as_bytes()));
}
