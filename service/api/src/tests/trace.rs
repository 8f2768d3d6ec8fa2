//! Log lines of a request.

use std::io;
use std::sync::{Mutex, PoisonError};

use tracing::Level;

use super::*;

/// Lines of a log, kept.
#[derive(Debug, Clone, Default)]
struct Lines(Arc<Mutex<Vec<u8>>>);

impl io::Write for Lines {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        kept.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Lines {
    fn text(&self) -> String {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        String::from_utf8_lossy(&kept).into_owned()
    }
}

#[tokio::test]
async fn a_line_of_the_log_names_its_request_and_no_secret() {
    let bench = bench(&["agv_1"]).await;
    let lines = Lines::default();
    let writer = lines.clone();
    let log = tracing_subscriber::fmt()
        .with_max_level(Level::DEBUG)
        .with_ansi(false)
        .with_writer(move || writer.clone());
    let _log = tracing::subscriber::set_default(log.finish());
    let id = [("x-request-id", "req-7")];
    bench
        .send("GET", "/api/v1/robots/agv_1?password=hush", &id)
        .await;
    let nobody = [
        ("x-request-id", "req-8"),
        ("authorization", "Bearer cal_wrong"),
    ];
    bench.send("GET", "/api/v1/robots", &nobody).await;
    let text = lines.text();
    let of = |id: &str| {
        let id = format!("request_id=\"{id}\"");
        let mut found = text.lines().filter(|line| line.contains(&id));
        found
            .find(|line| line.contains("answered"))
            .unwrap_or_else(|| panic!("{text}"))
    };
    let known = of("req-7");
    for part in [
        "request{method=GET route=\"/api/v1/robots/{id}\"",
        "actor=\"tester\"",
        "status=400",
        "latency_s=",
    ] {
        assert!(known.contains(part), "{part} in {known}");
    }
    let refused = of("req-8");
    assert!(
        refused.contains("status=401") && !refused.contains("actor"),
        "{refused}"
    );
    for secret in [bench.token.as_str(), "hush", "cal_wrong", "agv_1?"] {
        assert!(!text.contains(secret), "{secret} in {text}");
    }
}
