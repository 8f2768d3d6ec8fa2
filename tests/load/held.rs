//! A service that is held to part of the CPU time that it needs, by a control group.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use fleetcal_tests::service::Service;

/// Folder of the control groups of CPU time, version 1.
const CPU: &str = "/sys/fs/cgroup/cpu";
/// Period of a quota.
const PERIOD: Duration = Duration::from_millis(100);

/// Control group of one service, gone when it is dropped.
#[derive(Debug)]
pub struct Held {
    folder: PathBuf,
}

impl Held {
    /// Moves the service into a group of its own, without a limit; `None` where the system or the
    /// user may not.
    pub fn new(service: &Service) -> Option<Self> {
        let folder = Path::new(CPU).join(format!("fleetcal-load-{}", service.pid()));
        fs::create_dir(&folder).ok()?;
        let held = Self { folder };
        held.write("cgroup.procs", &service.pid().to_string())
            .ok()?;
        Some(held)
    }

    /// Limits the service to so many cores; without a number to none.
    pub fn limit(&self, cores: Option<f64>) {
        let quota_us = cores.map_or(-1, |cores| (cores * PERIOD.as_micros() as f64) as i64);
        self.write("cpu.cfs_period_us", &PERIOD.as_micros().to_string())
            .unwrap();
        self.write("cpu.cfs_quota_us", &quota_us.to_string())
            .unwrap();
    }

    fn write(&self, file: &str, value: &str) -> std::io::Result<()> {
        fs::write(self.folder.join(file), value)
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        // Its processes go back first: a group with processes is not removed.
        if let Ok(processes) = fs::read_to_string(self.folder.join("cgroup.procs")) {
            for process in processes.lines() {
                drop(fs::write(Path::new(CPU).join("cgroup.procs"), process));
            }
        }
        drop(fs::remove_dir(&self.folder));
    }
}
