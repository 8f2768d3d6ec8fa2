//! Extent of the campaign.

use fleetcal_robot::simulator::{ImperfectionKind, Strength};

use super::cell::Flaw;

/// Imperfections at whose typical size a robot converges correctly within 180 s of aisles.
const CONVERGING: [ImperfectionKind; 5] = [
    ImperfectionKind::SteeringGain,
    ImperfectionKind::Wheelbase,
    ImperfectionKind::SteeringAsymmetry,
    ImperfectionKind::Backlash,
    ImperfectionKind::SteeringLag,
];

/// Extent of the campaign.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImperfectExtent {
    /// Unchanged robots of each imperfection and route: seeds 1 to this.
    pub seeds: u64,
    /// Length of their runs, s.
    pub length_s: f64,
    /// True if strong imperfections are driven too.
    pub strong: bool,
    /// Changed robots of each imperfection, route, change and speed.
    pub change_seeds: u64,
    /// True if a change happens on robots of every imperfection instead of those that have to
    /// converge.
    pub all_changes: bool,
}

impl ImperfectExtent {
    /// Returns the imperfections of unchanged robots.
    pub fn flaws(&self) -> Vec<Flaw> {
        let mut flaws = Flaw::all();
        flaws.retain(|flaw| self.strong || flaw.strength() != Strength::Strong.name());
        flaws
    }

    /// Returns the imperfections of robots that change.
    pub fn changed_flaws(&self) -> Vec<Flaw> {
        let few = |flaw: &Flaw| match flaw {
            Flaw::Clean => true,
            Flaw::One(kind, _) => CONVERGING.contains(kind),
            Flaw::AllTypical => false,
        };
        let mut flaws = Flaw::all();
        flaws.retain(|flaw| flaw.strength() != Strength::Strong.name());
        flaws.retain(|flaw| self.all_changes || few(flaw));
        flaws
    }
}
