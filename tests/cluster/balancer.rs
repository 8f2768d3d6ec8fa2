//! `HAProxy` as `examples/deploy/cluster/haproxy.cfg` sets it: before an instance on each machine, with TLS,
//! so that instances ask each other over it, and before all of them for people.

use std::fs;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use fleetcal_tests::certificates::Authority;
use fleetcal_tests::http;
use fleetcal_tests::service::wait_for;

use crate::cluster::{Cluster, Instance, kept_port};
use crate::process::Process;

const INSTANCES: [&str; 2] = ["a", "b"];
const ROBOTS: usize = 4;
/// Time within which the load balancer, which checks every second, removes an instance after two
/// failed checks.
const CHECKED_WITHIN: Duration = Duration::from_secs(6);

/// Load balancer of one machine.
struct Balancer {
    /// Address for people.
    people: SocketAddr,
    /// Address for other machines, with TLS.
    own: SocketAddr,
}

/// Makes the configuration from the example, with this machine's addresses and files in place of
/// the three machines'. Every replaced text has to be there. People come without TLS here.
fn configuration(name: &str, http: SocketAddr, all: &[Balancer], own: usize, pki: &Path) -> String {
    let example = Path::new(env!("CARGO_MANIFEST_DIR"));
    let example = example.join("../examples/deploy/cluster/haproxy.cfg");
    let example = fs::read_to_string(example).unwrap();
    // The servers of PostgreSQL have tests of their own.
    let (people, _) = example.split_once("# The primary, for psql").unwrap();
    let mut text = people.to_owned();
    let server =
        |name: &str, at: &Balancer| format!("server {name} {} verifyhost localhost", at.own);
    for (from, to) in [
        ("    user haproxy\n    group haproxy\n", String::new()),
        (
            "bind :443 ssl crt /etc/haproxy/fleetcal.example.com.pem",
            format!("bind {}", all[own].people),
        ),
        (
            "bind :8443 ssl crt /etc/haproxy/n1.pem",
            format!("bind {} ssl crt {}", all[own].own, pki.join(name).display()),
        ),
        (
            "ca-file /etc/fleetcal/pki/ca.pem",
            format!("ca-file {}", pki.join("ca.pem").display()),
        ),
        (
            "server a n1.example.com:8443 verifyhost n1.example.com",
            server("a", &all[0]),
        ),
        (
            "server b n2.example.com:8443 verifyhost n2.example.com",
            server("b", &all[1]),
        ),
        (
            "    server c n3.example.com:8443 verifyhost n3.example.com\n",
            String::new(),
        ),
        ("server this 127.0.0.1:8080", format!("server this {http}")),
    ] {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, &to);
    }
    text
}

/// Writes certificate and key into one file, as the load balancer expects them.
fn certificate(authority: &Authority, name: &str, into: &Path) {
    authority.sign(name);
    let parts = [format!("{name}.pem"), format!("{name}.key.pem")];
    let parts = parts.map(|part| fs::read_to_string(authority.path(&part)).unwrap());
    fs::write(into, parts.concat()).unwrap();
}

fn start(program: &Path, config: &str, file: &Path) -> Process {
    fs::write(file, config).unwrap();
    let mut command = Command::new(program);
    Process::start(
        command.arg("-db").arg("-f").arg(file),
        file.with_extension("log"),
    )
}

/// Sends requests to every address for people, twenty times each: all answer with 200.
fn all_answer(all: &[Balancer], path: &str, token: &str) {
    for at in all.iter().cycle().take(20 * all.len()) {
        assert_eq!(status(at.people, path, token), Some(200), "{}", at.people);
    }
}

/// Returns the status of `GET path` at an address with a token.
fn status(at: SocketAddr, path: &str, token: &str) -> Option<u16> {
    http::get(at, path, Some(token)).map(|answer| answer.status)
}

/// Waits until an instance returns an answer that another one alone has.
fn wait_until_forwarded(asked: &Instance, path: &str) {
    wait_for("another instance's answer", || {
        (status(asked.http, path, asked.token()) == Some(200)).then_some(())
    });
}

/// Returns a driving robot of an instance, as shown there.
fn robot_of(instance: &Instance) -> String {
    wait_for("a robot of the instance", || {
        let list = instance.try_get("/api/v1/robots?limit=100")?;
        let mut robots = list["items"].as_array()?.iter();
        let own = robots
            .find(|robot| robot["instance"] == instance.name && robot["estimate"].is_object())?;
        own["id"].as_str().map(str::to_owned)
    })
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn requests_pass_haproxy_and_instances_ask_each_other_over_tls() {
    let program = std::env::var_os("FLEETCAL_HAPROXY").map(PathBuf::from);
    let program = program.expect("FLEETCAL_HAPROXY names HAProxy: make cluster-test");
    let mut cluster = Cluster::new(&INSTANCES, ROBOTS).await;
    let pki = cluster.folder().join("pki");
    fs::create_dir(&pki).unwrap();
    let authority = Authority::new(&pki);
    let all = INSTANCES.map(|_| Balancer {
        people: kept_port(),
        own: kept_port(),
    });
    let peers = INSTANCES.iter().zip(&all);
    let peers = peers.map(|(name, at)| format!("{name} = \"https://localhost:{}\"", at.own.port()));
    let peers: Vec<_> = peers.collect();
    cluster.peers = format!(
        "peers = {{ {} }}\npeer_root_certificates = {:?}\n",
        peers.join(", "),
        authority.path("ca.pem")
    );
    let mut balancers = Vec::new();
    for (own, name) in INSTANCES.iter().enumerate() {
        certificate(&authority, name, &pki.join(name));
        let config = configuration(name, cluster.http(name), &all, own, &pki);
        balancers.push(start(&program, &config, &pki.join(format!("{name}.cfg"))));
    }
    let a = cluster.start("a", 0);
    let mut b = cluster.start("b", 1);
    let _robots = cluster.drive();
    let path = format!("/api/v1/robots/{}/top-view", robot_of(&b));

    // What b alone knows, asked of a: over TLS, checked against b's certificate.
    wait_until_forwarded(&a, &path);
    // And through HAProxy, at whichever instance.
    std::thread::sleep(CHECKED_WITHIN);
    all_answer(&all, &path, a.token());

    // Killed: people get no more errors once HAProxy has seen it.
    b.process.kill();
    std::thread::sleep(CHECKED_WITHIN);
    all_answer(&all, "/api/v1/robots?limit=100", a.token());

    let b = cluster.start("b", 1);
    let path = format!("/api/v1/robots/{}/top-view", robot_of(&b));
    wait_until_forwarded(&a, &path);
    a_certificate_of_another_authority_is_refused(
        &program,
        &cluster,
        &all,
        &mut balancers,
        &a,
        &path,
    );
}

/// Checks a load balancer of b with the certificate of another authority: a sends it no
/// credentials.
fn a_certificate_of_another_authority_is_refused(
    program: &Path,
    cluster: &Cluster,
    all: &[Balancer],
    balancers: &mut [Process],
    a: &Instance,
    path: &str,
) {
    let pki = cluster.folder().join("pki");
    let strange = cluster.folder().join("strange");
    fs::create_dir(&strange).unwrap();
    certificate(&Authority::new(&strange), "b", &pki.join("b"));
    balancers[1].kill();
    let config = configuration("b", cluster.http("b"), all, 1, &pki);
    balancers[1] = start(program, &config, &pki.join("b.cfg"));
    let refused = wait_for("a refusal", || {
        let answer = http::get(a.http, path, Some(a.token()))?;
        (answer.body.contains("certificate")).then_some(answer)
    });
    assert!((500..600).contains(&refused.status), "{refused:?}");
}
