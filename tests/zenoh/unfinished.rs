//! Messages whose end never comes: what a session holds of them has a limit, and robots lose nothing.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::ops::Range;
use std::time::Duration;

use fleetcal_domain::limits;
use fleetcal_tests::service::Service;
use serde_json::json;
use zenoh::pubsub::Publisher;

use super::lists::{received, wait_until_received};
use super::raw_peer::{Channel, RawPeer};
use super::{robot, session};

/// Samples of a robot beside each attack of the sessions.
const SAMPLES: u64 = 200;
/// Growth of a service beyond the limit while messages are copied and pages are returned, bytes.
const BESIDE_BYTES: u64 = 48 << 20;
/// Number of long fragments, and the bytes of one, a batch nearly: together close to the largest message.
const LONG: (u64, usize) = (40, 48_000);
/// Sessions of one address that begin messages on all channels: twice its share.
const SESSIONS: u128 = 2 * limits::ZENOH_SESSIONS_PER_ADDRESS_DEFAULT as u128;
/// Address of these sessions; the robot has another one.
const FROM: IpAddr = IpAddr::V4(Ipv4Addr::new(127, 0, 0, 2));
/// Measurements of the memory while messages are received.
const LOOKS: u32 = 20;
const LOOK_EVERY: Duration = Duration::from_millis(25);

/// Returns the usual channels of a session, and all of them.
fn channels(priorities: &[Option<u8>]) -> Vec<Channel> {
    let both = |&priority| {
        [true, false].map(|is_reliable| Channel {
            is_reliable,
            priority,
        })
    };
    priorities.iter().flat_map(both).collect()
}

/// Returns the growth of a service while each of these sessions begins a message on each of these
/// channels.
async fn grown(
    service: &Service,
    zids: Range<u128>,
    channels: &[Channel],
    (fragments, bytes): (u64, usize),
) -> u64 {
    let endpoint = service.endpoint();
    let to: SocketAddr = endpoint.trim_start_matches("tcp/").parse().unwrap();
    let before = service.memory_bytes();
    let mut peers = Vec::new();
    for zid in zids {
        // One beyond the share is closed, maybe before it is open.
        let Ok(mut peer) = RawPeer::open(FROM, to, zid).await else {
            continue;
        };
        let begun = |&channel| peer.begin_message(channel, fragments, bytes);
        drop(channels.iter().try_for_each(begun));
        peers.push(peer);
    }
    let mut most = 0;
    for _ in 0..LOOKS {
        tokio::time::sleep(LOOK_EVERY).await;
        most = most.max(service.memory_bytes().saturating_sub(before));
    }
    most
}

async fn send_beside(service: &Service, stream: &Publisher<'static>, sent: &mut u64) {
    robot::send(stream, SAMPLES).await;
    *sent += SAMPLES;
    wait_until_received(service, "robot_a", *sent);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_all_sessions_of_one_owner_begin_and_never_end_is_bounded() {
    let service = Service::start(&["robot_a"]);
    let config = session::client(&service.endpoint(), &json!({}));
    let session = session::open(config).await.unwrap();
    let stream = robot::stream(&session, "robot_a").await;
    let mut sent = 0;
    send_beside(&service, &stream, &mut sent).await;

    let every: Vec<Option<u8>> = [None].into_iter().chain((0..8).map(Some)).collect();
    let grown = grown(&service, 1..1 + SESSIONS, &channels(&every), LONG).await;
    println!("{SESSIONS} sessions: +{} MiB", grown >> 20);
    send_beside(&service, &stream, &mut sent).await;
    assert_eq!(received(&service, "robot_a"), sent);
    let most = limits::ZENOH_UNFINISHED_BYTES_DEFAULT as u64 + BESIDE_BYTES;
    assert!(grown <= most, "{grown} bytes, expected at most {most}");
}
