//! State of the database and the instances, and the effect of each step.

use std::time::Duration;

use fleetcal_cluster::Lease;
use fleetcal_domain::limits::CLUSTER_LEASE;

pub const STEP_S: u64 = 2;
/// Bits of an epoch below the database's timeline.
pub const EPOCHS: u64 = 16;

pub type Incarnation = u8;

/// Life of an instance.
pub type Seat = (usize, Incarnation);

/// Row of a robot.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Default)]
pub struct Row {
    pub owner: Option<Seat>,
    pub epoch: u64,
    /// Next owner of the robot, named by the present one, and true if it receives the robot.
    pub heir: Option<(Seat, bool)>,
}

/// Contents of the database.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Default)]
pub struct Database {
    pub incarnations: Vec<Incarnation>,
    pub expires_at_s: Vec<u64>,
    pub row: Row,
    /// Epoch of the latest accepted write.
    pub written: u64,
    /// Epoch and instance of each accepted writer.
    pub writers: Vec<(u64, usize)>,
}

/// Memory of an instance.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Default)]
pub struct Instance {
    pub incarnation: Option<Incarnation>,
    pub trusted_until_s: u64,
    /// Epoch in which it has the robot.
    pub tenure: Option<u64>,
    /// Write under way to the database, by its tenure.
    pub writing: Option<(Incarnation, u64)>,
    /// Put that has passed the gate and is not made yet, by its tenure.
    pub putting: Option<u64>,
    /// True if it has ended its tenure in order to hand the robot over.
    pub handing_over: bool,
    pub process: Process,
    pub cut_off: bool,
}

/// State of an instance's process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Process {
    #[default]
    Running,
    Frozen,
    /// Killed, and not restarted yet.
    Killed,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, Default)]
pub struct World {
    pub now_s: u64,
    pub timeline: u64,
    pub database: Database,
    /// Contents of the standby.
    pub standby: Database,
    pub failovers_left: u8,
    pub freezes_left: u8,
    pub cuts_left: u8,
    pub kills_left: u8,
    /// Number of heirs that may still be named.
    pub moves_left: u8,
    pub instances: Vec<Instance>,
    /// Epoch of the latest put.
    pub put: u64,
    /// Writes that were accepted after one of a later tenure.
    pub late_writes: u8,
    /// Puts after one of a later tenure by an instance that does not have the robot any more.
    pub late_puts: u8,
    /// Epoch and instance of each put.
    pub putters: Vec<(u64, usize)>,
}

/// Part that is removed from the mechanism, to show that it is needed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Planted {
    Nothing,
    /// Writes are accepted whatever their tenure.
    NoFence,
    /// Puts skip the gate.
    NoGate,
    /// Epochs are incremented from the last one, even if a failover lost some.
    EpochWithoutTimeline,
    /// Owners that hand a robot over continue to estimate it, and leave their epoch to the heir.
    HandedOverWithItsEpoch,
}

impl World {
    pub fn lease_s() -> u64 {
        CLUSTER_LEASE.as_secs()
    }

    /// True if an instance gets an answer of the database.
    pub fn reaches(&self, i: usize) -> bool {
        let instance = &self.instances[i];
        instance.process == Process::Running && !instance.cut_off
    }

    pub fn is_killed(&self, i: usize) -> bool {
        self.instances[i].process == Process::Killed
    }

    pub fn has_seat(&self, i: usize) -> bool {
        self.instances[i].incarnation == Some(self.database.incarnations[i])
    }

    pub fn join(&mut self, i: usize) {
        self.database.incarnations[i] += 1;
        self.free(i);
        self.database.expires_at_s[i] = self.now_s + Self::lease_s();
        let incarnation = self.database.incarnations[i];
        let trusted = Lease::trusted_after(Duration::from_secs(self.now_s));
        let instance = &mut self.instances[i];
        instance.incarnation = Some(incarnation);
        (instance.tenure, instance.handing_over) = (None, false);
        instance.trusted_until_s = trusted.as_secs();
    }

    /// Frees the robot of an instance.
    pub fn free(&mut self, i: usize) {
        let row = &mut self.database.row;
        if row.owner.is_some_and(|(owner, _)| owner == i) {
            (row.owner, row.heir) = (None, None);
        }
    }

    pub fn renew(&mut self, i: usize) {
        if self.has_seat(i) {
            self.database.expires_at_s[i] = self.now_s + Self::lease_s();
            let trusted = Lease::trusted_after(Duration::from_secs(self.now_s));
            self.instances[i].trusted_until_s = trusted.as_secs();
        } else {
            let instance = &mut self.instances[i];
            (instance.incarnation, instance.tenure) = (None, None);
            instance.handing_over = false;
            instance.trusted_until_s = 0;
        }
    }

    /// Clears an instance's memory. Its requests that the database has received remain: the
    /// connection that writes and the one whose end the others observe are two.
    pub fn kill(&mut self, i: usize) {
        self.kills_left -= 1;
        self.instances[i] = Instance {
            writing: self.instances[i].writing,
            process: Process::Killed,
            ..Instance::default()
        };
    }

    /// True if an instance may be declared dead: with `fast_takeover` a killed one before its lease
    /// ends.
    pub fn may_take_for_dead(&self, by: usize, whom: usize) -> bool {
        by != whom
            && self.reaches(by)
            && self.has_seat(by)
            && self.database.incarnations[whom] > 0
            && (self.database.expires_at_s[whom] <= self.now_s || self.is_killed(whom))
            && self
                .database
                .row
                .owner
                .is_some_and(|(owner, _)| owner == whom)
    }

    pub fn claim(&mut self, i: usize, planted: Planted) {
        self.raise_epoch(planted);
        let row = &mut self.database.row;
        row.owner = self.instances[i].incarnation.map(|own| (i, own));
        row.heir = None;
        self.instances[i].tenure = Some(row.epoch);
    }

    pub fn raise_epoch(&mut self, planted: Planted) {
        let least = match planted {
            Planted::EpochWithoutTimeline => 0,
            _ => self.timeline * EPOCHS,
        };
        let row = &mut self.database.row;
        row.epoch = (row.epoch + 1).max(least);
    }

    /// Life of an instance that others may hand a robot to.
    pub fn live(&self, i: usize) -> Option<Seat> {
        let lives = self.database.incarnations[i] > 0 && self.database.expires_at_s[i] > self.now_s;
        lives.then_some((i, self.database.incarnations[i]))
    }

    /// State of an heir: true once it has confirmed that it receives the robot; `None` if the rows
    /// do not name it as the heir.
    pub fn is_heir(&self, i: usize) -> Option<bool> {
        let own = self.instances[i].incarnation?;
        let (heir, ready) = self.database.row.heir?;
        (heir == (i, own) && self.has_seat(i)).then_some(ready)
    }

    /// True if it can hand its robot over to an heir that receives it.
    pub fn has_ready_heir(&self, i: usize) -> bool {
        self.owns(i) && matches!(self.database.row.heir, Some((_, true)))
    }

    /// Passes the robot on to its heir, if the heir is alive.
    pub fn hand_over(&mut self, i: usize, planted: Planted) {
        self.instances[i].handing_over = false;
        let Some((heir, _)) = self.database.row.heir.filter(|_| self.owns(i)) else {
            return;
        };
        if self.live(heir.0) == Some(heir) {
            if planted != Planted::HandedOverWithItsEpoch {
                self.raise_epoch(planted);
            }
            (self.database.row.owner, self.database.row.heir) = (Some(heir), None);
        }
    }

    /// Starts to estimate the robot in the epoch of the rows if it is its own by them, and drops it
    /// if not.
    pub fn follow(&mut self, i: usize) {
        let tenure = self.owns(i).then_some(self.database.row.epoch);
        let instance = &mut self.instances[i];
        (instance.tenure, instance.handing_over) = (tenure, false);
    }

    pub fn owns(&self, i: usize) -> bool {
        let own = self.instances[i].incarnation;
        own.is_some_and(|own| self.database.row.owner == Some((i, own))) && self.has_seat(i)
    }

    /// True if the database accepts a write of this tenure: the seat is its instance's, and the
    /// robot that seat's, in this epoch.
    pub fn accepts(&self, i: usize, (incarnation, epoch): (Incarnation, u64)) -> bool {
        self.database.incarnations[i] == incarnation
            && self.database.row.owner == Some((i, incarnation))
            && self.database.row.epoch == epoch
    }

    pub fn accept(&mut self, i: usize, epoch: u64) {
        let kept = &mut self.database;
        self.late_writes += u8::from(epoch < kept.written);
        kept.written = kept.written.max(epoch);
        if !kept.writers.contains(&(epoch, i)) {
            kept.writers.push((epoch, i));
        }
    }

    /// Replaces the primary by the standby, and loses the commits that it lacks.
    pub fn fail_over(&mut self) {
        self.failovers_left -= 1;
        self.timeline += 1;
        self.database = self.standby.clone();
    }

    /// True if this world recovers without further faults: in the end the robot has an owner that
    /// has its tenure. Killed processes do not return.
    pub fn recovers(&self, planted: Planted) -> bool {
        let mut world = self.clone();
        for instance in &mut world.instances {
            if instance.process == Process::Frozen {
                instance.process = Process::Running;
            }
            instance.cut_off = false;
        }
        for _ in 0..Self::lease_s() {
            for i in 0..world.instances.len() {
                if world.is_killed(i) {
                    continue;
                }
                if world.instances[i].incarnation.is_none() {
                    world.join(i);
                }
                world.renew(i);
                for whom in 0..world.instances.len() {
                    if world.may_take_for_dead(i, whom) {
                        world.database.incarnations[whom] += 1;
                        world.free(whom);
                    }
                }
                if world.has_seat(i) && world.database.row.owner.is_none() {
                    world.claim(i, planted);
                }
                // What the rows say is its own, and it does not know, it takes on.
                if world.owns(i) {
                    world.instances[i].tenure = Some(world.database.row.epoch);
                }
            }
            world.now_s += STEP_S;
        }
        let owner = world.database.row.owner;
        owner.is_some_and(|(i, _)| {
            world.has_seat(i) && world.instances[i].tenure == Some(world.database.row.epoch)
        })
    }
}
