//! Requests of one instance to another over real sockets.

use std::net::SocketAddr;
use std::sync::Arc;

use fleetcal_domain::access::FORWARDED_BY;
use rcgen::{BasicConstraints, CertificateParams, IsCa, Issuer, KeyPair};
use rustls::ServerConfig;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::TcpListener;
use tokio_rustls::TlsAcceptor;

use super::*;

const ANSWER: &str = "HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nServer: secret\r\n\
                      Content-Length: 2\r\nConnection: close\r\n\r\n{}";

fn named(name: &str) -> ServiceInstance {
    ServiceInstance::parse(name).unwrap()
}

fn setup(url: &str, root_certificates: Option<PathBuf>) -> PeersSetup {
    PeersSetup {
        instance: named("a"),
        url: "https://a.example.com".parse().unwrap(),
        urls: BTreeMap::from([(named("b"), url.parse().unwrap())]),
        root_certificates,
        plaintext: true,
    }
}

/// Reads one request and answers it; returns the request.
async fn answer(mut socket: impl AsyncRead + AsyncWrite + Unpin) -> String {
    let mut request = Vec::new();
    while !request.ends_with(b"\r\n\r\n") {
        let mut bytes = [0; 1024];
        let count = socket.read(&mut bytes).await.unwrap();
        assert!(count > 0, "a whole header");
        request.extend_from_slice(&bytes[..count]);
    }
    socket.write_all(ANSWER.as_bytes()).await.unwrap();
    socket.shutdown().await.unwrap();
    String::from_utf8(request).unwrap()
}

async fn listener() -> (TcpListener, SocketAddr) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    (listener, address)
}

async fn ask(peers: &Peers, to: &str) -> Result<Response<Incoming>, ForwardError> {
    let mut headers = HeaderMap::new();
    headers.insert("authorization", "Bearer cal_x".parse().unwrap());
    headers.insert("x-forwarded-for", "198.51.100.1".parse().unwrap());
    headers.insert("x-other", "kept here".parse().unwrap());
    let request = Forwarded {
        method: &Method::GET,
        target: "/api/v1/robots/agv_1/top-view?x=1",
        headers: &headers,
        client: Some("203.0.113.9".parse().unwrap()),
    };
    peers.forward(&named(to), request).await
}

#[tokio::test]
async fn the_credential_and_the_callers_address_are_passed_on_and_nothing_else() {
    let (listener, address) = listener().await;
    let peers = Peers::start(
        setup(&format!("http://{address}"), None),
        CancellationToken::new(),
    );
    let peers = peers.unwrap();
    let serving = tokio::spawn(async move { answer(listener.accept().await.unwrap().0).await });
    let answered = ask(&peers, "b").await.unwrap();
    assert_eq!(answered.status(), 200);
    assert_eq!(answered.headers()["content-type"], "application/json");
    assert!(!answered.headers().contains_key("server"));
    let request = serving.await.unwrap().to_lowercase();
    let lines: Vec<&str> = request.trim_end().lines().collect();
    assert_eq!(lines[0], "get /api/v1/robots/agv_1/top-view?x=1 http/1.1");
    let mut rest = lines[1..].to_vec();
    rest.sort_unstable();
    let host = format!("host: {address}");
    let by = format!("{FORWARDED_BY}: a");
    let mut expected = [
        "authorization: bearer cal_x",
        host.as_str(),
        by.as_str(),
        "x-forwarded-for: 203.0.113.9",
    ];
    expected.sort_unstable();
    assert_eq!(rest, expected);
}

#[tokio::test]
async fn only_configured_instances_are_asked() {
    let peers = setup("http://127.0.0.1:9", None);
    let peers = Peers::start(peers, CancellationToken::new()).unwrap();
    let unknown = ask(&peers, "c").await.unwrap_err().to_string();
    assert_eq!(
        unknown,
        "instance c is not among cluster.peers of this instance"
    );
    let alone = ask(&Peers::default(), "b").await.unwrap_err();
    assert!(matches!(alone, ForwardError::Unknown(_)));
    let addresses = peers.addresses().unwrap();
    let loopback: IpAddr = "127.0.0.1".parse().unwrap();
    assert_eq!(*addresses.borrow(), BTreeSet::from([loopback]));
    assert_eq!(peers.own_authority(), Some("a.example.com"));
}

#[tokio::test]
async fn plaintext_has_to_be_named() {
    let refused = PeersSetup {
        plaintext: false,
        ..setup("http://b.example.com:8080", None)
    };
    let refused = Peers::start(refused, CancellationToken::new());
    let words = refused.unwrap_err().to_string();
    assert!(
        words.starts_with("cluster.peers.b: got http://b.example.com:8080, expected https://"),
        "{words}"
    );
    let encrypted = PeersSetup {
        plaintext: false,
        ..setup("https://b.example.com:8080", None)
    };
    assert!(encrypted.check().is_ok());
}

#[tokio::test]
async fn an_authority_that_cannot_be_read_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ca.pem");
    for text in [None, Some("no certificate")] {
        if let Some(text) = text {
            std::fs::write(&path, text).unwrap();
        }
        let refused = setup("https://b", Some(path.clone()));
        let refused = Peers::start(refused, CancellationToken::new()).unwrap_err();
        let words = refused.to_string();
        assert!(
            words.starts_with("cluster.peer_root_certificates"),
            "{words}"
        );
    }
}

/// Authority, and a server's certificate by it for `localhost`, as PEM.
fn certificates() -> (String, TlsAcceptor) {
    let mut params = CertificateParams::new(Vec::new()).unwrap();
    params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
    let authority_key = KeyPair::generate().unwrap();
    let authority = params.self_signed(&authority_key).unwrap().pem();
    let issuer = Issuer::new(params, authority_key);
    let key = KeyPair::generate().unwrap();
    let params = CertificateParams::new(vec!["localhost".to_owned()]).unwrap();
    let certificate = params.signed_by(&key, &issuer).unwrap();
    let chain = CertificateDer::from_pem_slice(certificate.pem().as_bytes()).unwrap();
    let key = PrivateKeyDer::from_pem_slice(key.serialize_pem().as_bytes()).unwrap();
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ServerConfig::builder_with_provider(provider);
    let config = config.with_safe_default_protocol_versions().unwrap();
    let config = config.with_no_client_auth();
    let config = config.with_single_cert(vec![chain], key).unwrap();
    (authority, TlsAcceptor::from(Arc::new(config)))
}

/// Result of a request to an instance with a certificate of the first authority, when `trusted` is
/// trusted.
async fn over_tls(trusted: &str, server: TlsAcceptor, host: &str) -> Result<u16, ForwardError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ca.pem");
    std::fs::write(&path, trusted).unwrap();
    let (listener, address) = listener().await;
    let url = format!("https://{host}:{}", address.port());
    let peers = PeersSetup {
        plaintext: false,
        ..setup(&url, Some(path))
    };
    let peers = Peers::start(peers, CancellationToken::new()).unwrap();
    let serving = tokio::spawn(async move {
        let (socket, _) = listener.accept().await.unwrap();
        // The client ends the handshake where it does not trust the certificate.
        if let Ok(socket) = server.accept(socket).await {
            answer(socket).await;
        }
    });
    let answered = ask(&peers, "b")
        .await
        .map(|answer| answer.status().as_u16());
    serving.await.unwrap();
    answered
}

#[tokio::test]
async fn an_instance_shows_a_certificate_that_is_trusted() {
    let (authority, server) = certificates();
    let (other, _) = certificates();
    let trusted = over_tls(&authority, server.clone(), "localhost").await;
    assert_eq!(trusted.unwrap(), 200);
    let words = over_tls(&other, server.clone(), "localhost").await;
    let words = words.unwrap_err().to_string();
    assert!(words.contains("certificate"), "{words}");
    // The right authority, and another instance's name.
    let words = over_tls(&authority, server, "127.0.0.1").await;
    let words = words.unwrap_err().to_string();
    assert!(words.contains("certificate"), "{words}");
}
