//! Somebody who listens to an instance's live updates, as a page does.

use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::time::Duration;

use fleetcal_tests::service::now;
use serde_json::Value;

use crate::cluster::Instance;

/// Time to listen for estimates, which each robot publishes once a second: later ones never come.
const LISTENS_FOR: Duration = Duration::from_secs(20);

/// Listens until the estimates of this number of robots have come, or the time is over; returns
/// those robots.
pub fn robots_told(instance: &Instance, robots: usize) -> BTreeSet<String> {
    let mut connection = TcpStream::connect(instance.http).unwrap();
    connection.set_read_timeout(Some(LISTENS_FOR)).unwrap();
    let request = format!(
        "GET /api/v1/stream HTTP/1.1\r\nHost: {}\r\nAuthorization: Bearer {}\r\n\r\n",
        instance.http,
        instance.token()
    );
    connection.write_all(request.as_bytes()).unwrap();
    let began = now();
    let (mut told, mut is_estimate) = (BTreeSet::new(), false);
    for line in BufReader::new(connection).lines().map_while(Result::ok) {
        if let Some(event) = line.strip_prefix("event: ") {
            is_estimate = event == "estimate";
        } else if let Some(data) = line.strip_prefix("data: ").filter(|_| is_estimate) {
            let estimate: Value = serde_json::from_str(data).unwrap_or_default();
            told.extend(estimate["robot"].as_str().map(str::to_owned));
        }
        if told.len() == robots || began.elapsed() > LISTENS_FOR {
            break;
        }
    }
    told
}
