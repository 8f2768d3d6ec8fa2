//! Places for connections and requests, when more come than are served.
//!
//! Places are shared by address. When all are taken, an address of which no connection waits for its
//! peer gets one: that of the address with the most waiting connections that has waited longest
//! goes. An address that has its share already is refused at once, at the cost of an accept. So
//! peers that are silent, slow or do not read keep each other out, however often they come back,
//! and a probe that asks at once is answered at once.

use std::cmp::Reverse;
use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use fleetcal_clock::SharedClock;
use fleetcal_domain::limits;
use tokio_util::sync::CancellationToken;

use super::client_address::PeerAddress;
use super::instances::InstanceAddresses;
use super::progress::{Progress, Waiting};
use super::refusal::Turned;
use super::shares::{Share, Shares};
use crate::trusted_proxies::TrustedProxies;

/// Open connections, and counters of the refusals.
#[derive(Debug, Clone)]
pub struct Connections(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    clock: SharedClock,
    trusted: TrustedProxies,
    instances: InstanceAddresses,
    table: Mutex<Table>,
    requests: Shares,
    turned: [AtomicU64; Turned::ALL.len()],
}

#[derive(Debug, Default)]
struct Table {
    next: u64,
    open: BTreeMap<u64, Entry>,
    /// Addresses with connections, except trusted proxies and other instances.
    addresses: HashMap<String, Address>,
    /// Requests in progress, except probes.
    requests: usize,
}

#[derive(Debug, Default)]
struct Address {
    connections: usize,
    waiting: Waiting,
}

#[derive(Debug)]
struct Entry {
    /// Address of the connection; `None` for a trusted proxy or another instance, which stands for
    /// many.
    address: Option<String>,
    /// Number of its address's connections that wait for their peer.
    beside: Waiting,
    progress: Arc<Progress>,
    in_request: bool,
    cut: CancellationToken,
}

/// Place of a connection, which is freed on drop.
#[derive(Debug)]
pub struct Place {
    id: u64,
    peer: PeerAddress,
    progress: Arc<Progress>,
    cut: CancellationToken,
    connections: Connections,
}

/// A request in progress.
#[derive(Debug)]
pub struct RequestPlace {
    place: Arc<Place>,
    is_counted: bool,
    _of_address: Option<Share>,
}

impl Connections {
    /// Makes an empty table of connections.
    pub fn new(clock: SharedClock, trusted: TrustedProxies) -> Self {
        Self::of_cluster(clock, trusted, InstanceAddresses::default())
    }

    /// Makes an empty table of connections for one instance of several.
    pub fn of_cluster(clock: SharedClock, trusted: TrustedProxies, of: InstanceAddresses) -> Self {
        Self(Arc::new(Inner {
            clock,
            trusted,
            instances: of,
            table: Mutex::default(),
            requests: Shares::new(limits::HTTP_REQUESTS_PER_ADDRESS_MAX),
            turned: std::array::from_fn(|_| AtomicU64::new(0)),
        }))
    }

    /// Returns the proxies and the other instances, whose forwarded client addresses may be
    /// trusted.
    pub(crate) fn believed(&self) -> (&TrustedProxies, &InstanceAddresses) {
        (&self.0.trusted, &self.0.instances)
    }

    /// Counts a refusal.
    pub fn count(&self, reason: Turned) {
        if let Some(counter) = self.0.turned.get(reason as usize) {
            counter.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Returns the number of refusals by reason.
    pub fn turned(&self) -> [(&'static str, u64); Turned::ALL.len()] {
        let value = |reason: Turned| self.0.turned.get(reason as usize);
        Turned::ALL.map(|reason| {
            let count = value(reason).map_or(0, |counter| counter.load(Ordering::Relaxed));
            (reason.as_str(), count)
        })
    }

    /// Returns the number of open connections.
    pub fn open(&self) -> usize {
        self.table().open.len()
    }

    fn table(&self) -> MutexGuard<'_, Table> {
        self.0.table.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Finds a place for a new connection; another one may be cut for it.
    pub(crate) fn admit(&self, peer: PeerAddress) -> Result<Arc<Place>, Turned> {
        let stands_for_many =
            |address| self.0.trusted.contain(address) || self.0.instances.contain(address);
        let address = (!peer.0.is_some_and(stands_for_many)).then(|| peer.key());
        let mut table = self.table();
        if table.connections_of(address.as_deref()) >= limits::HTTP_CONNECTIONS_PER_ADDRESS_MAX {
            let now = self.0.clock.elapsed();
            let freed = table.evict(|entry, since| {
                entry.address == address && now.saturating_sub(since) >= limits::HTTP_EVICTED_AFTER
            });
            self.evicted(freed, Turned::AddressConnections)?;
        }
        if table.open.len() >= limits::HTTP_CONNECTIONS_MAX {
            let freed = table.evict_for(address.as_deref());
            self.evicted(freed, Turned::Places)?;
        }
        let beside = table.waiting_of(address.as_deref());
        let progress = Progress::new(Arc::clone(&self.0.clock), beside.clone());
        let cut = CancellationToken::new();
        let id = table.insert(Entry {
            address,
            beside,
            progress: Arc::clone(&progress),
            in_request: false,
            cut: cut.clone(),
        });
        drop(table);
        Ok(Arc::new(Place {
            id,
            peer,
            progress,
            cut,
            connections: self.clone(),
        }))
    }

    /// Cuts the connection that has waited longest, when the process has no file left to open.
    pub(crate) fn make_room(&self) {
        if self.table().evict(|_, _| true) {
            self.count(Turned::Evicted);
        }
    }

    /// Counts the connection that was cut, or returns the given refusal if none was.
    fn evicted(&self, freed: bool, otherwise: Turned) -> Result<(), Turned> {
        if !freed {
            return Err(otherwise);
        }
        self.count(Turned::Evicted);
        Ok(())
    }

    /// Cuts each connection whose peer has not done its part in time.
    pub(crate) fn cut_overdue(&self) {
        let mut table = self.table();
        let overdue: Vec<_> = table
            .open
            .iter()
            .filter_map(|(id, entry)| Some((*id, entry.progress.overdue()?)))
            .collect();
        for (id, overdue) in overdue {
            table.cut(id);
            self.count(overdue.into());
        }
    }
}

impl Table {
    fn connections_of(&self, address: Option<&str>) -> usize {
        let known = address.and_then(|address| self.addresses.get(address));
        known.map_or(0, |address| address.connections)
    }

    /// Returns the counter of an address's waiting connections; each connection of a trusted proxy,
    /// which stands for many, has its own.
    fn waiting_of(&self, address: Option<&str>) -> Waiting {
        let known = address.and_then(|address| self.addresses.get(address));
        known.map_or_else(Waiting::default, |address| address.waiting.clone())
    }

    fn insert(&mut self, entry: Entry) -> u64 {
        if let Some(address) = &entry.address {
            let known = self.addresses.entry(address.clone());
            let known = known.or_insert_with(|| Address {
                connections: 0,
                waiting: entry.beside.clone(),
            });
            known.connections += 1;
        }
        let id = self.next;
        self.next += 1;
        self.open.insert(id, entry);
        id
    }

    fn remove(&mut self, id: u64) -> Option<Entry> {
        let entry = self.open.remove(&id)?;
        entry.progress.leave();
        if let Some(address) = &entry.address
            && let Some(known) = self.addresses.get_mut(address)
        {
            known.connections = known.connections.saturating_sub(1);
            if known.connections == 0 {
                self.addresses.remove(address);
            }
        }
        Some(entry)
    }

    fn cut(&mut self, id: u64) {
        if let Some(entry) = self.remove(id) {
            entry.cut.cancel();
        }
    }

    /// Makes room for one more connection of an address, if it is its turn; returns whether it did.
    /// An address without waiting connections is next; for any other, only a connection of an
    /// address with more of them is cut.
    fn evict_for(&mut self, address: Option<&str>) -> bool {
        let own = self.waiting_of(address).count();
        if own == 0 {
            return self.evict(|_, _| true);
        }
        let counts = self.addresses.values().map(|known| known.waiting.count());
        let most = counts.max().unwrap_or(0);
        // Else the two would take the place from each other again and again.
        if own + 1 >= most {
            return false;
        }
        self.evict(|entry, _| entry.beside.count() > own + 1)
    }

    /// Cuts one of the connections that wait for their peer and satisfy `fits`, with the start of
    /// their wait: of the address with the most waiting, the one that has waited longest. Returns
    /// whether one was cut.
    fn evict(&mut self, fits: impl Fn(&Entry, Duration) -> bool) -> bool {
        let waiting = self.open.iter().filter_map(|(id, entry)| {
            let since = entry.progress.waits_since()?;
            fits(entry, since).then(|| (Reverse(entry.beside.count()), since, *id))
        });
        let Some((_, _, id)) = waiting.min() else {
            return false;
        };
        self.cut(id);
        true
    }
}

impl Place {
    /// Returns the address of the connection's peer.
    pub(crate) fn peer(&self) -> PeerAddress {
        self.peer
    }

    /// Returns the table that the connection belongs to.
    pub(crate) fn connections(&self) -> &Connections {
        &self.connections
    }

    /// Returns the progress of the connection.
    pub(crate) fn progress(&self) -> &Arc<Progress> {
        &self.progress
    }

    /// Completes when the connection has to end.
    pub(crate) async fn cut(&self) {
        self.cut.cancelled().await;
    }

    /// Begins a request from `client`. A probe is answered whatever else is in progress.
    pub(crate) fn begin(
        self: &Arc<Self>,
        client: PeerAddress,
        is_probe: bool,
    ) -> Result<RequestPlace, Turned> {
        let connections = &self.connections;
        let mut of_address = None;
        if !is_probe {
            let share = connections.0.requests.take(client.key());
            of_address = Some(share.ok_or(Turned::AddressRequests)?);
        }
        let mut table = connections.table();
        if !is_probe && table.requests >= limits::HTTP_REQUESTS_MAX {
            let freed = table.evict(|entry, _| entry.in_request);
            connections.evicted(freed, Turned::Requests)?;
        }
        table.requests += usize::from(!is_probe);
        if let Some(entry) = table.open.get_mut(&self.id) {
            entry.in_request = true;
        }
        Ok(RequestPlace {
            place: Arc::clone(self),
            is_counted: !is_probe,
            _of_address: of_address,
        })
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.connections.table().remove(self.id);
    }
}

impl Drop for RequestPlace {
    fn drop(&mut self) {
        self.place.progress.request_ends();
        let mut table = self.place.connections.table();
        table.requests -= usize::from(self.is_counted);
        if let Some(entry) = table.open.get_mut(&self.place.id) {
            entry.in_request = false;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::net::IpAddr;

    use super::*;
    use fleetcal_clock::MockClock;

    fn connections(clock: &Arc<MockClock>, trusted: &[&str]) -> Connections {
        let trusted = trusted.iter().map(|range| range.parse().unwrap()).collect();
        Connections::new(clock.clone(), trusted)
    }

    fn at(number: usize) -> PeerAddress {
        let [.., c, d] = number.to_be_bytes();
        PeerAddress(Some(IpAddr::from([10, 0, c, d])))
    }

    fn count(connections: &Connections, reason: Turned) -> u64 {
        let mut turned = connections.turned().into_iter();
        turned.find(|(name, _)| *name == reason.as_str()).unwrap().1
    }

    #[test]
    fn a_new_connection_takes_the_place_of_the_one_that_waits_longest_of_the_busiest_address() {
        let clock = MockClock::at(0);
        let connections = connections(&clock, &[]);
        let alone = connections.admit(at(0)).unwrap();
        clock.advance(Duration::from_secs(1));
        let crowd: Vec<_> = (1..limits::HTTP_CONNECTIONS_MAX)
            .map(|number| connections.admit(at(1 + number / 10)).unwrap())
            .collect();
        let probe = connections.admit(at(999)).unwrap();
        assert_eq!(connections.open(), limits::HTTP_CONNECTIONS_MAX);
        assert!(!alone.cut.is_cancelled() && !probe.cut.is_cancelled());
        assert_eq!(
            crowd
                .iter()
                .filter(|place| place.cut.is_cancelled())
                .count(),
            1
        );
        assert_eq!(count(&connections, Turned::Evicted), 1);
    }

    #[test]
    fn what_the_service_works_for_is_not_cut() {
        let clock = MockClock::at(0);
        let connections = connections(&clock, &[]);
        let places: Vec<_> = (0..limits::HTTP_CONNECTIONS_MAX)
            .map(|number| connections.admit(at(number)).unwrap())
            .collect();
        for place in &places {
            place.progress.request_begins(false);
        }
        assert_eq!(connections.admit(at(999)).unwrap_err(), Turned::Places);
        drop(places);
        assert_eq!(connections.open(), 0);
        assert!(connections.table().addresses.is_empty());
    }

    #[test]
    fn an_address_has_its_own_limit_and_a_trusted_proxy_has_none() {
        let clock = MockClock::at(0);
        let connections = connections(&clock, &["10.0.0.9"]);
        let open = |number, count| -> Vec<_> {
            let all = (0..count).map(|_| connections.admit(at(number)).unwrap());
            all.collect()
        };
        let first = open(1, limits::HTTP_CONNECTIONS_PER_ADDRESS_MAX);
        let behind = open(9, limits::HTTP_CONNECTIONS_PER_ADDRESS_MAX + 1);
        assert!(behind.iter().all(|place| !place.cut.is_cancelled()));
        let too_early = connections.admit(at(1)).unwrap_err();
        assert_eq!(too_early, Turned::AddressConnections);
        clock.advance(limits::HTTP_EVICTED_AFTER);
        let one_more = connections.admit(at(1)).unwrap();
        assert_eq!(
            first
                .iter()
                .filter(|place| place.cut.is_cancelled())
                .count(),
            1
        );
        for place in first.iter().chain([&one_more]) {
            place.progress.request_begins(false);
        }
        assert_eq!(
            connections.admit(at(1)).unwrap_err(),
            Turned::AddressConnections
        );
    }

    #[test]
    fn requests_leave_places_for_probes() {
        let clock = MockClock::at(0);
        let connections = connections(&clock, &[]);
        let places: Vec<_> = (0..limits::HTTP_REQUESTS_MAX)
            .map(|number| connections.admit(at(number)).unwrap())
            .collect();
        let begin = |place: &Arc<Place>, is_probe| {
            place.progress.request_begins(false);
            place.begin(place.peer(), is_probe)
        };
        let under_way: Vec<_> = places
            .iter()
            .map(|place| begin(place, false).unwrap())
            .collect();
        let late = connections.admit(at(999)).unwrap();
        assert_eq!(begin(&late, false).unwrap_err(), Turned::Requests);
        assert!(begin(&late, true).is_ok());
        // One that does not read makes room.
        places.first().unwrap().progress.request_begins(true);
        assert!(begin(&late, false).is_ok());
        assert!(places.first().unwrap().cut.is_cancelled());
        drop(under_way);
        assert_eq!(connections.table().requests, 0);
    }

    #[test]
    fn one_address_has_so_many_requests_under_way() {
        let clock = MockClock::at(0);
        let connections = connections(&clock, &["10.0.0.9"]);
        let place = connections.admit(at(9)).unwrap();
        let held: Vec<_> = (0..limits::HTTP_REQUESTS_PER_ADDRESS_MAX)
            .map(|_| place.begin(at(1), false).unwrap())
            .collect();
        assert_eq!(
            place.begin(at(1), false).unwrap_err(),
            Turned::AddressRequests
        );
        assert!(place.begin(at(2), false).is_ok());
        drop(held);
        assert!(place.begin(at(1), false).is_ok());
    }

    #[test]
    fn who_is_overdue_is_cut_and_counted() {
        let clock = MockClock::at(0);
        let connections = connections(&clock, &[]);
        let silent = connections.admit(at(1)).unwrap();
        clock.advance(limits::HTTP_HEADER_TIMEOUT);
        let fresh = connections.admit(at(1)).unwrap();
        connections.cut_overdue();
        assert!(silent.cut.is_cancelled() && !fresh.cut.is_cancelled());
        assert_eq!(count(&connections, Turned::IdleTimeout), 1);
    }

    #[test]
    fn who_comes_back_again_and_again_gets_no_more_than_a_share() {
        const ATTACKERS: usize = 250;
        let clock = MockClock::at(0);
        let connections = connections(&clock, &[]);
        let mut open = Vec::new();
        for number in 0..4 * limits::HTTP_CONNECTIONS_MAX {
            open.extend(connections.admit(at(number % ATTACKERS)));
        }
        let cut = |open: &[Arc<Place>]| {
            let cut = open.iter().filter(|place| place.cut.is_cancelled());
            cut.count()
        };
        assert_eq!((open.len(), cut(&open)), (limits::HTTP_CONNECTIONS_MAX, 0));
        // Whoever is there for the first time, or works with what it has, is let in.
        let mut working = Vec::new();
        for _ in 0..10 {
            let place = connections.admit(at(ATTACKERS)).unwrap();
            place.progress.request_begins(false);
            working.push(place);
        }
        // The attackers get none of that room.
        for number in 0..4 * limits::HTTP_CONNECTIONS_MAX {
            open.extend(connections.admit(at(number % ATTACKERS)));
        }
        assert_eq!(cut(&working), 0);
        assert_eq!(cut(&open), working.len());
        assert_eq!(connections.open(), limits::HTTP_CONNECTIONS_MAX);
    }
}
