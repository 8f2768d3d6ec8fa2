//! Study 7: robots that do not obey the model.

use fleetcal_robot::simulator::Strength;

use crate::error::EvaluationError;
use crate::extent::Extent;
use crate::imperfect::tables::{
    Row, changed, changes_table, claims_table, errors_table, sensor_of, turns_table, unchanged,
};
use crate::imperfect::{
    Campaign, Flaw, ImperfectExtent, InjectedChange, Road, Sensor, Summary, Watch,
};
use crate::report::Section;
use crate::statistics::Proportion;

/// Runs the study.
///
/// # Errors
/// The error of a run.
pub fn study(extent: &Extent) -> Result<Section, EvaluationError> {
    let mut campaign = Campaign::new(Watch::whole(extent.imperfect.length_s));
    section(&extent.imperfect, &mut campaign)
}

/// Makes the study on a campaign, which may hold runs already.
///
/// # Errors
/// The error of a run.
pub fn section(
    extent: &ImperfectExtent,
    campaign: &mut Campaign,
) -> Result<Section, EvaluationError> {
    let mut section = Section::new("7. Imperfect robots");
    introduce(&mut section, extent);
    let seeds: Vec<u64> = (1..=extent.seeds).collect();
    let claims = unchanged(campaign, &extent.flaws(), &seeds, &Road::ALL)?;
    section.words(
        "Runs with a false claim, at each time and at any of the four, with the upper end of the \
         exact one-sided 95 % interval (Clopper and Pearson; 3/N for none of N). *Worst claim* is \
         the largest error of a parameter called `converged`, in its own sigmas. *False changes* \
         are all changes and faults that were flagged, with the bound for one hour.",
    );
    section.table(claims_table(&claims));
    section.words(
        "The same robots after 180 s: how many called all four `converged`, and how many of those \
         rightly; root mean square of the errors; mean of the squared errors in published sigmas, \
         summed over the four (4 is right, less is cautious).",
    );
    section.table(errors_table(&claims));
    let change_seeds: Vec<u64> = (1..=extent.change_seeds).collect();
    for injected in InjectedChange::ALL {
        let flaws = extent.changed_flaws();
        let rows = changed(campaign, &flaws, &change_seeds, &Road::ALL, injected)?;
        section.words(format!(
            "**{}**, at 0.3 and 1 m/s on each route, anywhere on the lap and after two to five \
             minutes: way from the change to its flag with the right cause.",
            in_words(injected)
        ));
        section.table(changes_table(&rows));
        hold_changes(&mut section, injected, &rows);
        if injected == InjectedChange::MountMoved {
            section.words(
                "It shows in turns alone: how far robots without an imperfection drove until the flag, and \
                 until they had turned by 45°, by which 20 mm are 15 mm between two poses, each of which \
                 has 3 mm of noise.",
            );
            section.table(turns_table(campaign, &change_seeds, injected)?);
        }
    }
    hold_claims(&mut section, &claims);
    let two_sided = unchanged(campaign, &[Flaw::Clean], &seeds, &Road::TWO_SIDED)?;
    hold_convergence(&mut section, &two_sided);
    Ok(section)
}

fn introduce(section: &mut Section, extent: &ImperfectExtent) {
    section.words(format!(
        "Every study above drives robots that obey the model. These do not: each has one \
         imperfection of [what we assume of a robot](assumptions.md), at its typical or three times \
         its typical size, its sign drawn by seed; `all` has every one at once, each of half to one \
         and a half times its typical size. Mount, steering offset, speed scale and time offset are \
         drawn again for every seed, and the estimator knows the configured wheelbase alone. Routes \
         are the figure-eight, warehouse aisles with two reversals a lap, and a loop of left turns; \
         {} seeds each. A *false claim* is a parameter that is `converged` and more than four of \
         its own sigmas from the truth. `from` says what the LiDAR sends: scans where beams \
         matter, else poses of 3 mm and 0.03°.",
        extent.seeds
    ));
}

const fn in_words(injected: InjectedChange) -> &'static str {
    match injected {
        InjectedChange::Steering => "The steering zero jumps by 0.5°",
        InjectedChange::MountYaw => "The LiDAR turns by 0.5°",
        InjectedChange::MountMoved => "The LiDAR moves by 20 mm",
        InjectedChange::MountSideways => "The LiDAR moves by 10 mm to one side",
    }
}

/// Adds the claims about unchanged robots.
fn hold_claims(section: &mut Section, rows: &[Row]) {
    let typical = |row: &&Row| row.flaw.strength() != Strength::Strong.name();
    let from_poses = |row: &&Row| sensor_of(row.flaw) == Sensor::Poses;
    let held = rows.iter().filter(typical).filter(from_poses);
    let early = held.map(|row| false_until_180_s(&row.summary));
    let early = early.fold(Proportion::default(), |all, one| Proportion {
        count: all.count + one.count,
        of: all.of + one.of,
    });
    section.at_most(
        "false claims until 180 s of vehicles with one typical imperfection",
        early.share(),
        0.005,
        |share| format!("{:.2} % of {}", 100.0 * share, early.of),
    );
    if let Some(clean) = rows.iter().find(|row| row.flaw == Flaw::Clean) {
        let claims = clean.summary.false_claims();
        section.at_most(
            "false claims of robots without an imperfection",
            claims.share(),
            0.0,
            |share| format!("{:.2} %", 100.0 * share),
        );
    }
}

/// Adds the claims about robots without an imperfection that turn to both sides. Turns to one side
/// cannot separate the play of the steering from its offset, and may take longer.
fn hold_convergence(section: &mut Section, two_sided: &[Row]) {
    for clean in two_sided {
        section.at_least(
            "share of robots without an imperfection converged after 180 s of turns to both sides",
            clean.summary.converged_within_bounds().share(),
            0.95,
            |share| format!("{:.0} %", 100.0 * share),
        );
    }
}

/// Counts the false claims after 60, 120 and 180 s.
fn false_until_180_s(summary: &Summary) -> Proportion {
    let at = [60.0, 120.0, 180.0].map(|at_s| summary.false_claims_at(at_s));
    Proportion {
        count: at.iter().map(|one| one.count).sum(),
        of: at.iter().map(|one| one.of).sum(),
    }
}

/// Adds the claims about changed robots. A LiDAR that moves by 20 mm is not detected in time yet,
/// not even without an imperfection, and one that moves by 10 mm need not be detected.
fn hold_changes(section: &mut Section, injected: InjectedChange, rows: &[Row]) {
    let Some(clean) = rows.iter().find(|row| row.flaw == Flaw::Clean) else {
        return;
    };
    if matches!(
        injected,
        InjectedChange::MountMoved | InjectedChange::MountSideways
    ) {
        return;
    }
    for (share, name, bound_m) in [(0.5, "median", 6.0), (0.95, "95 %", 20.0)] {
        let what = format!(
            "{}, no imperfection: way to its flag, {name}",
            in_words(injected)
        );
        let way_m = clean.summary.flagged_after_m(share);
        section.at_most(&what, way_m, bound_m, |m| format!("{m:.1} m"));
    }
}
