//! Places of Zenoh sessions, of which more may come than there are places.
//!
//! Places are shared by name, of peers that show a password or a certificate, and else by address.
//! When all are taken, or all of those without a name, the newest session of whoever has the most
//! goes for one of somebody who would have fewer. So one client cannot keep the others out, however
//! many sessions it opens.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fmt;

use fleetcal_domain::limits;
use fleetcal_fleet::SessionClosed;

/// Owner of a session.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Owner {
    /// A user, or the common name of a certificate.
    Name(String),
    /// An address; for IPv6 a network.
    Address(String),
}

impl Owner {
    const fn is_nameless(&self) -> bool {
        matches!(self, Self::Address(_))
    }
}

impl fmt::Display for Owner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Name(name) => f.write_str(name),
            Self::Address(address) => f.write_str(address),
        }
    }
}

/// Largest numbers of sessions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shares {
    /// Sessions in total.
    pub all: usize,
    /// Sessions without a name.
    pub nameless: usize,
    /// Sessions of one address.
    pub of_address: usize,
    /// Sessions of one name.
    pub of_name: usize,
}

impl Shares {
    /// Limits the total to that of a router which opens at most `sessions`, with the same part left
    /// for sessions that wait for a place.
    #[must_use]
    pub fn within(self, sessions: usize) -> Self {
        let opened = limits::ZENOH_SESSIONS_MAX + limits::ZENOH_SESSIONS_OPENING_MAX;
        let all = sessions.saturating_mul(limits::ZENOH_SESSIONS_MAX) / opened;
        Self {
            all: self.all.min(all.max(1)),
            ..self
        }
    }
}

impl Shares {
    /// Limits the sessions without a name to those whose unfinished messages fill a part of the
    /// memory that the process may use, bytes.
    #[must_use]
    pub fn within_memory(self, bytes: u64) -> Self {
        let of_session = limits::ZENOH_UNFINISHED_PER_SESSION_MAX * limits::ZENOH_MESSAGE_BYTES_MAX;
        let bytes = usize::try_from(bytes).unwrap_or(usize::MAX);
        let nameless = bytes / limits::ZENOH_UNFINISHED_MEMORY_PART / of_session;
        Self {
            nameless: self.nameless.min(nameless.max(1)),
            ..self
        }
    }
}

impl Default for Shares {
    fn default() -> Self {
        Self {
            all: limits::ZENOH_SESSIONS_MAX,
            nameless: limits::ZENOH_SESSIONS_MAX,
            of_address: limits::ZENOH_SESSIONS_PER_ADDRESS_DEFAULT,
            of_name: limits::ZENOH_SESSIONS_PER_NAME_DEFAULT,
        }
    }
}

/// Sessions that are counted together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Of {
    /// All sessions.
    All,
    /// Sessions without a name.
    Nameless,
}

/// Open sessions, each with the value that closes it.
#[derive(Debug)]
pub struct Places<C> {
    shares: Shares,
    next: u64,
    open: BTreeMap<u64, (Owner, C)>,
    owners: HashMap<Owner, BTreeSet<u64>>,
}

impl<C> Places<C> {
    /// Makes places that are all free.
    pub fn new(shares: Shares) -> Self {
        Self {
            shares,
            next: 0,
            open: BTreeMap::new(),
            owners: HashMap::new(),
        }
    }

    /// Returns the number of sessions that have a place.
    pub fn taken(&self) -> usize {
        self.open.len()
    }

    /// Describes the owner of the most places when all are taken, or all without a name, else an
    /// owner with its full share.
    pub fn crowded(&self) -> Option<String> {
        for (of, places) in [
            (Of::All, ""),
            (Of::Nameless, " without a name (sessions_without_name)"),
        ] {
            if self.are_all_taken(of) {
                let (owner, count) = self.greediest(of)?;
                let taken = self.taken_of(of);
                return Some(format!(
                    "all {taken} places of Zenoh sessions{places} are taken, {count} of them by {owner}"
                ));
            }
        }
        let mut owners = self.owners.iter();
        let (owner, own) = owners.find(|(owner, own)| own.len() >= self.share(owner))?;
        let count = own.len();
        Some(format!(
            "{owner} has {count} Zenoh sessions, which is all of its share"
        ))
    }

    fn share(&self, owner: &Owner) -> usize {
        match owner {
            Owner::Name(_) => self.shares.of_name,
            Owner::Address(_) => self.shares.of_address,
        }
    }

    /// Returns the owners and the numbers of their places.
    fn counts(&self, of: Of) -> impl Iterator<Item = (&Owner, usize)> {
        let owners = self.owners.iter();
        let owners = owners.filter(move |(owner, _)| of == Of::All || owner.is_nameless());
        owners.map(|(owner, own)| (owner, own.len()))
    }

    /// Returns the owner of the most places, and their number.
    pub fn greediest(&self, of: Of) -> Option<(&Owner, usize)> {
        let counts = self.counts(of);
        counts.max_by(|one, other| one.1.cmp(&other.1).then_with(|| other.0.cmp(one.0)))
    }

    fn taken_of(&self, of: Of) -> usize {
        match of {
            Of::All => self.open.len(),
            Of::Nameless => self.counts(of).map(|(_, count)| count).sum(),
        }
    }

    fn are_all_taken(&self, of: Of) -> bool {
        let places = match of {
            Of::All => self.shares.all,
            Of::Nameless => self.shares.nameless,
        };
        self.taken_of(of) >= places
    }

    /// Returns the places of which this owner's next session needs one that another has.
    fn contested(&self, owner: &Owner) -> Option<Of> {
        if owner.is_nameless() && self.are_all_taken(Of::Nameless) {
            Some(Of::Nameless)
        } else {
            self.are_all_taken(Of::All).then_some(Of::All)
        }
    }

    /// Admits a session; returns the number of its place, and the value that closes a session which
    /// is evicted for it.
    ///
    /// # Errors
    /// The owner has its full share, or nobody has more.
    pub fn admit(&mut self, owner: Owner, close: C) -> Result<(u64, Option<C>), SessionClosed> {
        let own = self.owners.get(&owner).map_or(0, BTreeSet::len);
        if own >= self.share(&owner) {
            return Err(SessionClosed::Share);
        }
        let evicted = match self.contested(&owner) {
            Some(of) => Some(self.newest_of_others(of, own).ok_or(SessionClosed::Full)?),
            None => None,
        };
        let evicted = evicted.and_then(|number| self.leave(number));
        let number = self.next;
        self.next += 1;
        self.owners.entry(owner.clone()).or_default().insert(number);
        self.open.insert(number, (owner, close));
        Ok((number, evicted))
    }

    /// Returns the newest session of the owner with the most, if an owner with `own` and one more
    /// would have fewer.
    fn newest_of_others(&self, of: Of, own: usize) -> Option<u64> {
        let (greediest, count) = self.greediest(of)?;
        let newest = self.owners.get(greediest)?.last().copied();
        newest.filter(|_| count > own + 1)
    }

    /// Frees all places of the owner of the newest session, of those without a name first; returns
    /// the owner and the values that close its sessions.
    pub fn leave_newest_owner(&mut self) -> Option<(Owner, Vec<C>)> {
        let newest = |of: Of| {
            let owners = self.owners.iter();
            let owners = owners.filter(move |(owner, _)| of == Of::All || owner.is_nameless());
            owners.max_by_key(|(_, own)| own.last().copied())
        };
        let (owner, own) = newest(Of::Nameless).or_else(|| newest(Of::All))?;
        let (owner, own) = (owner.clone(), own.clone());
        let closed = own.into_iter().filter_map(|number| self.leave(number));
        Some((owner, closed.collect()))
    }

    /// Frees a place; returns the value that closed its session.
    pub fn leave(&mut self, number: u64) -> Option<C> {
        let (owner, close) = self.open.remove(&number)?;
        if let Some(own) = self.owners.get_mut(&owner) {
            own.remove(&number);
            if own.is_empty() {
                self.owners.remove(&owner);
            }
        }
        Some(close)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places(all: usize) -> Places<&'static str> {
        Places::new(Shares {
            all,
            nameless: all,
            of_address: 4,
            of_name: 4,
        })
    }

    fn at(address: &str) -> Owner {
        Owner::Address(address.to_owned())
    }

    fn named(name: &str) -> Owner {
        Owner::Name(name.to_owned())
    }

    #[test]
    fn an_owner_has_its_share_and_no_more() {
        let mut places = places(8);
        for owner in [at("10.0.0.1"), named("robot_a")] {
            for _ in 0..4 {
                assert!(places.admit(owner.clone(), "idle").is_ok());
            }
            let crowded = format!("{owner} has 4 Zenoh sessions, which is all of its share");
            if places.taken() < 8 {
                assert_eq!(places.crowded(), Some(crowded));
            }
            assert_eq!(places.admit(owner, ""), Err(SessionClosed::Share));
        }
        assert_eq!(places.taken(), 8);
        let crowded = places.crowded().unwrap();
        let expected = "all 8 places of Zenoh sessions are taken, 4 of them by ";
        assert!(crowded.starts_with(expected), "{crowded}");
    }

    #[test]
    fn the_newest_owner_leaves_first_and_names_stay_longest() {
        let mut places = places(8);
        let (robot, bridge, flood) = (named("robot_a"), at("10.0.0.1"), at("10.0.0.2"));
        for (owner, session) in [
            (&flood, "f1"),
            (&bridge, "b"),
            (&flood, "f2"),
            (&robot, "r"),
        ] {
            places.admit(owner.clone(), session).unwrap();
        }
        assert_eq!(places.leave_newest_owner(), Some((flood, vec!["f1", "f2"])));
        assert_eq!(places.leave_newest_owner(), Some((bridge, vec!["b"])));
        assert_eq!(places.leave_newest_owner(), Some((robot, vec!["r"])));
        assert_eq!((places.leave_newest_owner(), places.taken()), (None, 0));
    }

    #[test]
    fn a_router_that_opens_fewer_sessions_has_fewer_places() {
        let of = |sessions| Shares::default().within(sessions).all;
        assert_eq!(of(4_352), 4_096);
        // They are all taken before it opens no more.
        assert_eq!(of(1_000), 941);
        assert_eq!((of(0), of(usize::MAX)), (1, 4_096));
        assert_eq!(places(8).shares.within(4_352), places(8).shares);
    }

    #[test]
    fn who_has_the_most_makes_room_for_others_until_all_have_as_many() {
        let mut places = places(6);
        for number in ["1", "2", "3", "4"] {
            assert!(places.admit(at("10.0.0.1"), number).is_ok());
        }
        assert!(places.admit(at("10.0.0.2"), "b").is_ok());
        assert!(places.admit(at("10.0.0.3"), "c").is_ok());
        assert!(places.are_all_taken(Of::All));
        let mut closed = Vec::new();
        for robot in ["robot_a", "robot_b"] {
            let (_, evicted) = places.admit(named(robot), robot).unwrap();
            closed.push(evicted.unwrap());
        }
        // The oldest stay: what was there before a flood goes on.
        assert_eq!(closed, ["4", "3"]);
        // A second one of the same would take the place of somebody who has no more.
        assert_eq!(places.admit(named("robot_a"), ""), Err(SessionClosed::Full));
        assert_eq!(places.taken(), 6);
    }

    #[test]
    fn sessions_without_a_name_share_what_the_memory_holds_of_their_unfinished_messages() {
        let of = |mib: u64| Shares::default().within_memory(mib << 20).nameless;
        assert_eq!((of(1), of(256), of(1_024)), (1, 31, 124));
        assert_eq!(of(u64::MAX >> 20), limits::ZENOH_SESSIONS_MAX);
        let mut places = Places::new(Shares {
            nameless: 3,
            ..places(6).shares
        });
        for number in ["1", "2", "3"] {
            assert!(places.admit(at("10.0.0.1"), number).is_ok());
        }
        let crowded = "all 3 places of Zenoh sessions without a name (sessions_without_name) are taken, 3 of them by 10.0.0.1";
        assert_eq!(places.crowded().unwrap(), crowded);
        assert_eq!(places.admit(at("10.0.0.1"), ""), Err(SessionClosed::Full));
        let (_, evicted) = places.admit(at("10.0.0.2"), "").unwrap();
        assert_eq!(evicted, Some("3"));
        // Names have places beside them, and lose none to who has no name.
        for _ in 0..3 {
            let (_, evicted) = places.admit(named("robot_a"), "a").unwrap();
            assert_eq!(evicted, None);
        }
        let (_, evicted) = places.admit(at("10.0.0.3"), "").unwrap();
        assert_eq!(evicted, Some("2"));
        assert_eq!(places.taken(), 6);
    }

    #[test]
    fn a_place_is_free_again_when_its_session_ends() {
        let mut places = places(6);
        let (number, _) = places.admit(at("10.0.0.1"), "first").unwrap();
        assert_eq!(places.leave(number), Some("first"));
        assert_eq!(places.leave(number), None);
        assert_eq!((places.taken(), places.greediest(Of::All)), (0, None));
    }
}
