//! Previews of unregistered robots, as the API and the link hold them.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};

use fleetcal_cluster::Duty;
use fleetcal_domain::robot::RobotConfig;
use fleetcal_domain::streams::RobotStreams;
use fleetcal_proto::RobotId;

use super::{FleetHandle, FleetRefused};
use crate::preview::Preview;

impl FleetHandle {
    /// Reads what an unregistered robot has sent since the first request by this configuration, which
    /// is not stored. Messages are kept for each configuration from the first request on. It takes as long as reading the messages: not
    /// for the threads of the runtime.
    ///
    /// # Errors
    /// The robot is unknown or registered, another instance receives it, or too many others have
    /// previews.
    pub fn preview(&self, id: &RobotId, config: RobotConfig) -> Result<Preview, FleetRefused> {
        let unknown = || FleetRefused::UnknownRobot(id.clone());
        let robot = self.fleet.find(id.as_str()).ok_or_else(unknown)?;
        if robot.is_configured() {
            return Err(FleetRefused::Registered(id.clone()));
        }
        let membership = &self.fleet.membership;
        if membership.cluster().is_some() && !membership.does(Duty::Discovery) {
            return Err(FleetRefused::Elsewhere(id.clone()));
        }
        let now = self.fleet.clock.elapsed();
        let previews = &self.fleet.previews;
        let asked = previews.ask(id, config, &self.fleet.estimator, now);
        let (previewed, is_begun) = asked.ok_or_else(|| FleetRefused::PreviewsMax(id.clone()))?;
        if is_begun {
            self.fleet.configuration_changed();
        }
        catch_unwind(AssertUnwindSafe(|| previewed.read())).map_err(|_| {
            self.fleet.count_panic();
            tracing::error!(robot.id = %id, "the preview of an unregistered robot failed");
            self.fleet.end_preview(id);
            FleetRefused::PreviewFailed(id.clone())
        })
    }

    /// Returns the topics of unregistered robots that have a preview.
    pub fn previewed_streams(&self) -> BTreeMap<RobotId, RobotStreams> {
        self.fleet.previews.streams()
    }
}
