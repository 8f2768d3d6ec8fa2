//! A network namespace for each instance, with a virtual Ethernet to the database, one to the router
//! and one for requests: three networks that fail apart from each other.
//!
//! A direction is cut by a permanent entry of the neighbour table with a hardware address that nobody
//! has: its packets are lost on their way, and no socket is told. Needs root.

use std::net::{IpAddr, SocketAddr};
use std::process::Command;
use std::sync::atomic::{AtomicU8, Ordering};

use crate::network::Cut;

/// Hardware address without an owner.
const NOBODY: &str = "02:00:00:00:00:fe";
/// Port of an instance's API in its namespace.
const HTTP_PORT: u16 = 8080;
/// Number of sets of networks that fit into 198.18.0.0/15, which is reserved for tests of networks
/// (RFC 2544).
const SETS: u8 = 64;

/// Purpose of a network; its number is a part of its addresses, its letter of its interfaces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Network {
    /// Instances and database.
    Database,
    /// Instances and routers.
    Router,
    /// Requests to instances, of people and of each other.
    Http,
}

impl Network {
    const ALL: [Self; 3] = [Self::Database, Self::Router, Self::Http];

    fn letter(self) -> char {
        match self {
            Self::Database => 'd',
            Self::Router => 'r',
            Self::Http => 'h',
        }
    }
}

/// Namespaces of a cluster's instances, removed with this value.
#[derive(Debug)]
pub struct Namespaces {
    /// Prefix of all names.
    name: String,
    set: u8,
    instances: Vec<&'static str>,
}

impl Namespaces {
    /// Makes networks and namespaces for these instances.
    pub fn new(instances: &[&'static str]) -> Self {
        static NEXT: AtomicU8 = AtomicU8::new(0);
        let process = std::process::id();
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let namespaces = Self {
            name: format!("fc{process}n{number}"),
            set: (process as u8).wrapping_mul(7).wrapping_add(number) % SETS,
            instances: instances.to_vec(),
        };
        for network in Network::ALL {
            let bridge = namespaces.bridge(network);
            ip(&format!("link add {bridge} type bridge"));
            let own = namespaces.own_address(network);
            ip(&format!("addr add {own}/24 dev {bridge}"));
            ip(&format!("link set {bridge} up"));
        }
        for instance in instances {
            namespaces.connect(instance);
        }
        namespaces
    }

    fn connect(&self, instance: &str) {
        let namespace = self.of(instance);
        ip(&format!("netns add {namespace}"));
        ip(&format!("-n {namespace} link set lo up"));
        for network in Network::ALL {
            let (bridge, letter) = (self.bridge(network), network.letter());
            let (outside, inside) = (format!("{namespace}{letter}"), device(network));
            let address = self.address(network, instance);
            ip(&format!(
                "link add {outside} type veth peer name {inside} netns {namespace}"
            ));
            ip(&format!("link set {outside} master {bridge} up"));
            ip(&format!(
                "-n {namespace} addr add {address}/24 dev {inside}"
            ));
            ip(&format!("-n {namespace} link set {inside} up"));
        }
    }

    fn bridge(&self, network: Network) -> String {
        format!("{}{}", self.name, network.letter())
    }

    /// Returns the namespace of an instance.
    fn of(&self, instance: &str) -> String {
        format!("{}{instance}", self.name)
    }

    fn at(&self, network: Network, host: u8) -> IpAddr {
        let third = self.set * Network::ALL.len() as u8 + network as u8;
        IpAddr::from([198, 18, third, host])
    }

    /// Returns the address of a network's servers, outside of the namespaces.
    pub fn own_address(&self, network: Network) -> IpAddr {
        self.at(network, 1)
    }

    fn address(&self, network: Network, instance: &str) -> IpAddr {
        let place = self.instances.iter().position(|one| *one == instance);
        self.at(network, place.unwrap() as u8 + 2)
    }

    /// Returns the address of an instance's API.
    pub fn http(&self, instance: &str) -> SocketAddr {
        SocketAddr::new(self.address(Network::Http, instance), HTTP_PORT)
    }

    /// Returns the line between an instance and a server at a port of a network's own address.
    pub fn wire(&self, network: Network, instance: &str, port: u16) -> Wire {
        Wire {
            namespace: self.of(instance),
            inside: device(network),
            outside: self.bridge(network),
            instance: self.address(network, instance),
            server: SocketAddr::new(self.own_address(network), port),
        }
    }

    /// Begins a command in an instance's namespace.
    pub fn command(&self, instance: &str) -> Command {
        let mut command = Command::new("ip");
        command.args(["netns", "exec", &self.of(instance)]);
        command
    }
}

impl Drop for Namespaces {
    fn drop(&mut self) {
        // With its last process a namespace takes its ends of the wires away.
        for instance in &self.instances {
            ip(&format!("netns del {}", self.of(instance)));
        }
        for network in Network::ALL {
            ip(&format!("link del {}", self.bridge(network)));
        }
    }
}

/// A line of an instance in its namespace.
#[derive(Debug, Clone)]
pub struct Wire {
    namespace: String,
    inside: String,
    outside: String,
    instance: IpAddr,
    /// Address of the server.
    pub server: SocketAddr,
}

impl Wire {
    /// Loses packets from now on.
    pub fn cut(&self, cut: Cut) {
        if cut != Cut::ToInstance {
            replace(&self.sent(), &format!("lladdr {NOBODY} nud permanent"));
        }
        if cut != Cut::FromInstance {
            replace(&self.received(), &format!("lladdr {NOBODY} nud permanent"));
        }
    }

    /// Forwards packets again.
    pub fn heal(&self) {
        // The address is asked for again with the next packet.
        for direction in [self.sent(), self.received()] {
            let [namespace, address, device] = direction;
            let entry = format!("{namespace} neigh del {address} dev {device}");
            let done = Command::new("ip").args(entry.split_whitespace()).output();
            let done = done.unwrap();
            let told = String::from_utf8_lossy(&done.stderr);
            // Of a cut in one direction the other one may have no entry.
            assert!(
                done.status.success() || told.contains("No such file"),
                "{told}"
            );
        }
    }

    fn sent(&self) -> [String; 3] {
        let namespace = format!("-n {}", self.namespace);
        [namespace, self.server.ip().to_string(), self.inside.clone()]
    }

    fn received(&self) -> [String; 3] {
        let instance = self.instance.to_string();
        [String::new(), instance, self.outside.clone()]
    }
}

/// Redirects the packets to an address.
fn replace([namespace, address, device]: &[String; 3], entry: &str) {
    ip(&format!(
        "{namespace} neigh replace {address} {entry} dev {device}"
    ));
}

/// Returns the interface of a network in every namespace.
fn device(network: Network) -> String {
    format!("eth{}", network.letter())
}

/// True if this process may make namespaces.
pub fn may_be_made() -> bool {
    let id = Command::new("id").arg("-u").output();
    id.is_ok_and(|id| id.stdout.trim_ascii() == b"0")
}

/// Runs `ip` (iproute2), which has to succeed.
fn ip(arguments: &str) {
    let output = Command::new("ip")
        .args(arguments.split_whitespace())
        .output();
    let output = output.unwrap_or_else(|error| panic!("ip cannot be run (iproute2): {error}"));
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "ip {arguments}: {told}");
}
