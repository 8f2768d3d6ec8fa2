//! Simulated drives: imperfection, road, sensor, vehicle, settings and incident in turn.

use fleetcal_estimator::vehicle::SpeedMeasuredAt;
use fleetcal_estimator::{Calibrator, Freedom, Vehicle, VehicleModel};
use fleetcal_evaluation::drive::Robot;
use fleetcal_evaluation::imperfect::{Cell, Flaw, Road, Scenario, Sensor, robot};
use fleetcal_robot::simulator::Simulation;

use super::Failure;
use super::incident::{INCIDENTS, Incident, Staged};
use super::lines::Lines;

/// Length of a drive, s.
const LENGTH_S: f64 = 150.0;

/// The robot of a drive, its incident, and the name of both. The numbers of choices have few
/// factors in common, so that further drives combine them in other ways.
fn staged(index: u64) -> (String, Robot, Incident) {
    let turn = index as usize;
    let flaws = Flaw::all();
    let flaw = flaws[turn % flaws.len()];
    let incident = INCIDENTS[turn % INCIDENTS.len()];
    let sensor = if flaw.needs_scans() || turn % 4 < 2 {
        Sensor::Scans
    } else {
        Sensor::Poses
    };
    let cell = Cell {
        flaw,
        road: Road::ALL[turn % Road::ALL.len()],
        sensor,
        scenario: Scenario::Unchanged,
    };
    let (mut robot, _) = robot(cell, index + 1, None);
    configure(&mut robot, turn);
    incident.prepare(&mut robot);
    let Cell { road, sensor, .. } = cell;
    let name = format!(
        "{index:03}_{}_{}_{}_{}_{incident:?}",
        flaw.name(),
        flaw.strength(),
        road.name(),
        sensor.name()
    );
    (name, robot, incident)
}

/// Makes some vehicles tricycles, and frees or fixes other parameters than by default on some.
fn configure(robot: &mut Robot, turn: usize) {
    let wheelbase_m = robot.calibrator.vehicle.wheelbase_m;
    if turn % 5 == 4 {
        robot.simulation.vehicle.model = VehicleModel::Tricycle;
        robot.calibrator.vehicle = Vehicle::new(VehicleModel::Tricycle, wheelbase_m);
    } else if turn % 11 == 10 {
        let lateral_m = 0.4 * wheelbase_m;
        robot.calibrator.vehicle.speed_measured_at = SpeedMeasuredAt::RearWheel { lateral_m };
    }
    let free = &mut robot.calibrator.settings.free;
    match turn % 7 {
        5 => free.wheelbase = Freedom::Estimated,
        6 => (free.wheelbase, free.steering_gain) = (Freedom::Off, Freedom::Estimated),
        _ => {}
    }
}

/// Drives one; returns its name, and the lines of what was published.
pub fn drive(index: u64) -> Result<(String, String), Failure> {
    let (name, robot, incident) = staged(index);
    let start_ns = robot.simulation.start_stamp_ns;
    let mut simulation = Simulation::new(robot.simulation)?;
    let mut lines = Lines::of(Calibrator::new(robot.calibrator));
    let mut staged = Staged::of(incident);
    loop {
        let emitted = simulation.advance();
        let time_s = (emitted.sent_ns - start_ns) as f64 * 1e-9;
        if time_s > LENGTH_S {
            return Ok((name, lines.end()));
        }
        staged.take(time_s, emitted, &mut lines)?;
    }
}
