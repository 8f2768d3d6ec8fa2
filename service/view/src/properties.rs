//! Properties of a robot that views select and sort by.

use fleetcal_domain::approval::RobotLedger;
use fleetcal_domain::deviation::Deviation;
use fleetcal_domain::robot::{ConnectionState, RobotState, RobotView};
use fleetcal_domain::standing::Standing;
use fleetcal_model::{Label, VehicleModel, WallTime};

/// Properties that a robot may lack, as `no:` names them.
pub(crate) const OPTIONAL: [&str; 6] = ["site", "type", "tag", "model", "deviation", "age"];

/// Properties of one robot at one moment.
#[derive(Debug, Clone)]
pub struct Properties<'a> {
    /// Id of the robot.
    pub id: &'a str,
    /// Site of the robot.
    pub site: Option<&'a Label>,
    /// Type of the vehicle by its maker.
    pub vehicle_type: Option<&'a Label>,
    /// Tags of the robot.
    pub tags: &'a [Label],
    /// Steering of the vehicle; `None` before its configuration.
    pub model: Option<VehicleModel>,
    /// State of the robot's estimate.
    pub state: RobotState,
    /// Standing of the robot.
    pub standing: Standing,
    /// True if the robot has sent nothing for some seconds.
    pub is_stale: bool,
    /// True while the robot is in maintenance.
    pub in_maintenance: bool,
    /// Deviation of the estimate from the calibration in use, in tolerances.
    pub deviation: Option<f64>,
    /// Time since the last message, s; `None` before the first one.
    pub age_s: Option<f64>,
}

impl<'a> Properties<'a> {
    /// Properties of a robot by its view and its records, at `now`.
    pub fn of(
        view: &'a RobotView,
        ledger: &RobotLedger,
        standing: Standing,
        deviation: Option<Deviation>,
        now: WallTime,
    ) -> Self {
        let config = view.config.as_ref();
        let maintenance = ledger.shadow.maintenance.as_ref();
        let heard = view.connection.last_heard();
        Self {
            id: view.id.as_str(),
            site: config.and_then(|config| config.site.as_ref()),
            vehicle_type: config.and_then(|config| config.vehicle_type.as_ref()),
            tags: config.map_or(&[], |config| config.tags.as_slice()),
            model: config.map(|config| config.model),
            state: view.state,
            standing,
            is_stale: view.connection.stale,
            in_maintenance: maintenance.is_some_and(|one| one.holds_at(now)),
            deviation: deviation.map(|one| one.tolerances),
            age_s: heard.map(|heard| now.0.saturating_sub(heard.0).max(0) as f64 / 1e9),
        }
    }

    /// True if the robot counts under a connection state. One in maintenance counts under that
    /// whether it sends or not.
    pub fn is_connected(&self, state: ConnectionState) -> bool {
        match state {
            ConnectionState::Online => !self.is_stale,
            ConnectionState::Silent => self.is_stale && !self.in_maintenance,
            ConnectionState::Maintenance => self.in_maintenance,
        }
    }

    /// True if the property that `no:` names is not known.
    pub(crate) fn lacks(&self, name: &str) -> bool {
        match name {
            "site" => self.site.is_none(),
            "type" => self.vehicle_type.is_none(),
            "tag" => self.tags.is_empty(),
            "model" => self.model.is_none(),
            "deviation" => self.deviation.is_none(),
            "age" => self.age_s.is_none(),
            _ => false,
        }
    }
}
