//! Runs the campaign of imperfect robots: one line for each cell as it finishes.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;
use fleetcal_evaluation::error::EvaluationError;
use fleetcal_evaluation::imperfect::{
    Campaign, Cell, Driven, Flaw, ImperfectExtent, InjectedChange, Place, Road, Scenario, Sensor,
    Summary, Watch,
};
use fleetcal_evaluation::results::{Figure, Origin, Results};
use fleetcal_evaluation::study::imperfect_robots;
use fleetcal_robot::simulator::Strength;

/// Drives imperfect robots and reports the numbers of false claims and the distances over which a
/// change went unseen.
///
/// Every cell is one imperfection at one strength on one route. Equal seeds give equal numbers.
#[derive(Debug, Parser)]
#[command(name = "imperfect_robots")]
struct Arguments {
    /// Imperfections by name, `none` or `all`; every one by default.
    #[arg(long, value_delimiter = ',')]
    only: Vec<String>,
    /// `typical` or `strong` alone. Changes happen on typical robots unless this is `strong`.
    #[arg(long, value_parser = ["typical", "strong"])]
    strength: Option<String>,
    /// Routes: eight, aisles, left.
    #[arg(long, value_delimiter = ',')]
    route: Vec<Road>,
    /// `claims` for unchanged robots, `changes` for injected changes; both by default.
    #[arg(long, value_parser = ["claims", "changes"])]
    scenario: Option<String>,
    /// Injected changes: `steering_0.5deg`, `mount_yaw_0.5deg`, `mount_20mm`,
    /// `mount_y_10mm`.
    #[arg(long, value_delimiter = ',')]
    change: Vec<InjectedChange>,
    /// LiDAR stream; by default poses, and scans for imperfections of single beams and for all at
    /// once.
    #[arg(long)]
    sensor: Option<Sensor>,
    /// Robots of each cell.
    #[arg(long, default_value_t = 8)]
    seeds: u64,
    /// Robots of each cell with a change; by default as many as of others.
    #[arg(long)]
    change_seeds: Option<u64>,
    /// Seed of the first robot.
    #[arg(long, default_value_t = 1)]
    first_seed: u64,
    /// Length of an unchanged robot's run, s: claims are evaluated after 60, 120, 180 and 600 s.
    #[arg(long, default_value_t = 600.0)]
    length: f64,
    /// Time from which the estimator receives the robots' messages, s: later than 0 it begins while
    /// they drive. All other times count from the robots' start on.
    #[arg(long, default_value_t = 0.0, value_parser = seconds)]
    heard_from: f64,
    /// Ways between which changes happen, m, as `22,46`; after two to five minutes by default.
    #[arg(long, value_parser = ways)]
    changed_within: Option<(f64, f64)>,
    /// Results file: runs in it are not run again, new ones are appended. It belongs to one
    /// state of the estimator.
    #[arg(long)]
    results: Option<PathBuf>,
    /// Writes the tables of every imperfection and route into this file, as Markdown.
    #[arg(long, conflicts_with_all = ["only", "strength", "route", "scenario", "change", "sensor", "first_seed", "heard_from", "changed_within", "list"])]
    report: Option<PathBuf>,
    /// Writes the figures of each cell into this file of `docs/results/data`, as JSON lines.
    #[arg(long, requires = "commit", requires = "date")]
    figures: Option<PathBuf>,
    /// Measured commit, for the figures.
    #[arg(long)]
    commit: Option<String>,
    /// Day of the run, for the figures.
    #[arg(long)]
    date: Option<String>,
    /// Lists the cells and runs none.
    #[arg(long)]
    list: bool,
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (0.0..=600.0).contains(&seconds) => Ok(seconds),
        _ => Err(format!("got {text:?}, expected seconds from 0 to 600")),
    }
}

fn ways(text: &str) -> Result<(f64, f64), String> {
    let ways = text.split_once(',').and_then(|(first, last)| {
        let [first_m, last_m] = [first, last].map(|way| way.trim().parse::<f64>().ok());
        Some((first_m?, last_m?))
    });
    match ways {
        Some((first_m, last_m)) if 0.0 <= first_m && first_m < last_m && last_m <= 300.0 => {
            Ok((first_m, last_m))
        }
        _ => Err(format!(
            "got {text:?}, expected two ways in m of 0 to 300, the shorter one first, as 22,46"
        )),
    }
}

impl Arguments {
    fn cells(&self) -> Result<Vec<Cell>, String> {
        let known = Flaw::all();
        for name in &self.only {
            if !known.iter().any(|flaw| flaw.name() == name) {
                let mut names: Vec<_> = known.iter().map(|flaw| flaw.name()).collect();
                names.dedup();
                return Err(format!(
                    "--only: got {name:?}, expected some of {}",
                    names.join(", ")
                ));
            }
        }
        let roads = if self.route.is_empty() {
            &Road::ALL[..]
        } else {
            &self.route
        };
        let mut cells = Vec::new();
        for flaw in known.into_iter().filter(|flaw| self.wants_flaw(*flaw)) {
            for &road in roads {
                for scenario in Scenario::all() {
                    if let Some(sensor) = self.sensor_for(flaw)
                        && self.wants_scenario(flaw, scenario)
                    {
                        cells.push(Cell {
                            flaw,
                            road,
                            sensor,
                            scenario,
                        });
                    }
                }
            }
        }
        Ok(cells)
    }

    fn seeds_of(&self, cell: Cell) -> Vec<u64> {
        let count = match cell.scenario {
            Scenario::Unchanged => self.seeds,
            Scenario::Changed(..) => self.change_seeds.unwrap_or(self.seeds),
        };
        (0..count).map(|number| self.first_seed + number).collect()
    }

    fn wants_flaw(&self, flaw: Flaw) -> bool {
        let named = self.only.is_empty() || self.only.iter().any(|name| name == flaw.name());
        let strength = self.strength.as_deref();
        named && strength.is_none_or(|strength| flaw.strength() == strength || flaw == Flaw::Clean)
    }

    /// Returns poses unless beams matter; `None` for beams on a robot that has to send poses.
    fn sensor_for(&self, flaw: Flaw) -> Option<Sensor> {
        match (self.sensor, flaw.needs_scans()) {
            (Some(Sensor::Poses), true) => None,
            (Some(sensor), _) => Some(sensor),
            (None, true) => Some(Sensor::Scans),
            (None, false) if flaw == Flaw::AllTypical => Some(Sensor::Scans),
            (None, false) => Some(Sensor::Poses),
        }
    }

    fn wants_scenario(&self, flaw: Flaw, scenario: Scenario) -> bool {
        let wanted = self.scenario.as_deref();
        match scenario {
            Scenario::Unchanged => wanted != Some("changes") && self.change.is_empty(),
            Scenario::Changed(change, _) => {
                let strong = flaw.strength() == Strength::Strong.name();
                wanted != Some("claims")
                    && (!strong || self.strength.is_some())
                    && (self.change.is_empty() || self.change.contains(&change))
            }
        }
    }
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let cells = match arguments.cells() {
        Ok(cells) => cells,
        Err(why) => {
            eprintln!("{why}");
            return ExitCode::from(2);
        }
    };
    match campaign(&arguments, &cells) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::from(2)
        }
    }
}

fn campaign(arguments: &Arguments, cells: &[Cell]) -> Result<(), EvaluationError> {
    let watch = Watch {
        length_s: arguments.length,
        heard_from_s: arguments.heard_from,
        changed_within_m: arguments.changed_within,
    };
    let mut campaign = match &arguments.results {
        Some(path) => Campaign::resumed(watch, path)?,
        None => Campaign::new(watch),
    };
    let mut pooled: Vec<(Place, Summary)> = Vec::new();
    for &cell in cells {
        if arguments.list {
            say(&cell.to_string());
            continue;
        }
        let outcomes = campaign.outcomes(cell, &arguments.seeds_of(cell))?;
        say(&Summary::of(cell, &outcomes).line(cell));
        let place = cell.place();
        match pooled.iter_mut().find(|(known, _)| *known == place) {
            Some((_, summary)) => summary.add(cell, &outcomes),
            None => pooled.push((place, Summary::of(cell, &outcomes))),
        }
    }
    if let Some(path) = &arguments.figures {
        let figures = pooled
            .iter()
            .flat_map(|(place, summary)| summary.figures(place));
        keep(arguments, path, figures.collect())?;
    }
    let Some(path) = &arguments.report else {
        return Ok(());
    };
    // Every run is known by now: this only pools them.
    let extent = ImperfectExtent {
        seeds: arguments.seeds,
        length_s: arguments.length,
        driven: Driven::All,
        change_seeds: arguments.change_seeds.unwrap_or(arguments.seeds),
    };
    let section = imperfect_robots::section(&extent, &mut campaign)?;
    std::fs::write(path, section.markdown()).map_err(|source| EvaluationError::Written {
        path: path.clone(),
        source,
    })
}

/// Writes the figures with their origin.
fn keep(arguments: &Arguments, path: &Path, figures: Vec<Figure>) -> Result<(), EvaluationError> {
    let flags = std::env::args().skip(1).collect::<Vec<_>>().join(" ");
    let command = flags.split(" --figures").next().unwrap_or_default();
    let results = Results {
        origin: Origin {
            campaign: "imperfect_robots".to_owned(),
            title: "Results on imperfect robots".to_owned(),
            commit: arguments.commit.clone().unwrap_or_default(),
            date: arguments.date.clone().unwrap_or_default(),
            command: format!("imperfect_robots {command}"),
        },
        figures,
    };
    let failed = |source| EvaluationError::Written {
        path: path.to_owned(),
        source,
    };
    let lines = results.lines().map_err(|error| failed(error.into()))?;
    std::fs::write(path, lines).map_err(failed)
}

#[expect(clippy::print_stdout, reason = "the lines are what the command is for")]
fn say(line: &str) {
    println!("{line}");
}
