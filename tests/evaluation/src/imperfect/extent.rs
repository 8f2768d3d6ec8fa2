//! Extent of the campaign.

use fleetcal_robot::simulator::{ImperfectionKind, Strength};

use super::cell::{Flaw, Sensor};
use super::tables::sensor_of;

/// Imperfections at whose typical size a robot converges correctly within 180 s of aisles.
const CONVERGING: [ImperfectionKind; 5] = [
    ImperfectionKind::SteeringGain,
    ImperfectionKind::Wheelbase,
    ImperfectionKind::SteeringAsymmetry,
    ImperfectionKind::Backlash,
    ImperfectionKind::SteeringLag,
];

/// Robots that are driven.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Driven {
    /// Every imperfection, typical and strong, and each change on robots of every typical one.
    All,
    /// Typical imperfections, and each change on robots that have to converge.
    Typical,
    /// Robots that the report's claims are about: typical imperfections that poses show, and each
    /// change on robots without an imperfection.
    Claimed,
}

/// Extent of the campaign.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImperfectExtent {
    /// Unchanged robots of each imperfection and route: seeds 1 to this.
    pub seeds: u64,
    /// Length of their runs, s.
    pub length_s: f64,
    /// Robots that are driven.
    pub driven: Driven,
    /// Changed robots of each imperfection, route, change and speed.
    pub change_seeds: u64,
}

impl ImperfectExtent {
    /// Returns the imperfections of unchanged robots.
    pub fn flaws(&self) -> Vec<Flaw> {
        let mut flaws = Flaw::all();
        flaws.retain(|&flaw| match self.driven {
            Driven::All => true,
            Driven::Typical => is_typical(flaw),
            Driven::Claimed => is_typical(flaw) && sensor_of(flaw) == Sensor::Poses,
        });
        flaws
    }

    /// Returns the imperfections of robots that change.
    pub fn changed_flaws(&self) -> Vec<Flaw> {
        let mut flaws = Flaw::all();
        flaws.retain(|&flaw| match (self.driven, flaw) {
            (_, Flaw::Clean) => true,
            (Driven::All, _) => is_typical(flaw),
            (Driven::Typical, Flaw::One(kind, _)) => is_typical(flaw) && CONVERGING.contains(&kind),
            (Driven::Typical, Flaw::AllTypical) | (Driven::Claimed, _) => false,
        });
        flaws
    }
}

fn is_typical(flaw: Flaw) -> bool {
    flaw.strength() != Strength::Strong.name()
}
