//! Configuration of a robot, as its task follows it.

use std::sync::Arc;

use fleetcal_domain::robot::RobotConfig;
use fleetcal_model::Version;
use fleetcal_proto::estimate::EstimateDocument;

use super::RobotTask;
use super::live_checks::LiveChecks;
use crate::intake::Intake;
use crate::reading::ReadingSettings;

impl RobotTask {
    /// Begins again if the robot's new configuration changes the basis of its estimate. Changes of
    /// topics and of the documents' frames are applied without.
    pub(crate) fn follow_config(&mut self) {
        if self.robot.config_version() == self.version {
            return;
        }
        if let Some((version, config)) = self.robot.versioned_config() {
            if config.basis(&self.fleet.estimator) == self.basis {
                self.go_on_by(version, &config);
                return;
            }
            let (fleet, robot) = (Arc::clone(&self.fleet), Arc::clone(&self.robot));
            let budgets = std::mem::take(&mut self.budgets);
            let (notes, is_open) = (self.notes.clone(), self.robot.is_reassembly_open());
            *self = Self::start(fleet, robot, version, &config, None);
            self.budgets = budgets;
            self.robot.set_notes_taken(notes.until);
            self.notes = notes;
            if is_open {
                self.reopen_reassembly();
            }
            self.save_checkpoint();
        }
    }

    fn go_on_by(&mut self, version: Version, config: &RobotConfig) {
        self.version = version;
        let reading = ReadingSettings::of(config);
        if reading != self.reading {
            self.intake = Intake::new(reading.clone());
            self.reading = reading;
            self.checks = LiveChecks::new(config, &[]);
        }
        self.rear_axle_in_base_link = config.rear_axle_in_base_link;
        if let Some(estimate) = self.robot.estimate() {
            let mut document = EstimateDocument::clone(&estimate);
            self.place_in_base_link(&mut document);
            self.robot.set_estimate(Arc::new(document));
        }
    }
}
