//! A robot's disk, and the agent's process on it.

use std::io::Read;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

use fleetcal_proto::calibration::{CalibrationDocument, CalibrationValues};
use fleetcal_tests::binary;
use tempfile::TempDir;

use crate::agent::service::{approved, key, offset_rad};

pub struct Robot {
    folder: TempDir,
    process: Option<Child>,
}

impl Robot {
    pub fn new() -> Self {
        let folder = TempDir::new().unwrap();
        Self {
            folder,
            process: None,
        }
    }

    pub fn start(&mut self, endpoint: &str) {
        let calls = self.path("calls");
        let hook = format!(
            "echo $FLEETCAL_CALL $FLEETCAL_GENERATION >> {}",
            calls.display()
        );
        let child = Command::new(binary::path())
            .args([
                "agent",
                "--robot",
                "tugger_01",
                "--connect",
                endpoint,
                "--apply",
            ])
            .arg(self.path("calibration.json"))
            .args(["--service-key", &key().public_key().to_string()])
            .args(["--hook", "sh", "--hook-arg=-c", "--hook-arg", &hook])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn();
        self.process = Some(child.unwrap());
    }

    /// Kills it as `kill -9` does.
    pub fn kill(&mut self) {
        let mut process = self.process.take().unwrap();
        process.kill().unwrap();
        process.wait().unwrap();
    }

    /// Stops it by a signal, and returns its output.
    pub fn stop(&mut self) -> String {
        let mut process = self.process.take().unwrap();
        let id = process.id().to_string();
        assert!(Command::new("kill").arg(&id).status().unwrap().success());
        assert!(process.wait().unwrap().success());
        let mut said = String::new();
        let mut stdout = process.stdout.take().unwrap();
        stdout.read_to_string(&mut said).unwrap();
        said
    }

    pub fn calls(&self) -> Vec<String> {
        let calls = std::fs::read_to_string(self.path("calls")).unwrap();
        calls.lines().map(str::to_owned).collect()
    }

    /// Returns the agent's memory.
    pub fn memory(&self) -> serde_json::Value {
        let memory = std::fs::read(self.path("calibration.json.agent.json")).unwrap();
        serde_json::from_slice(&memory).unwrap()
    }

    /// Returns the generation whose values the file holds, whole and as they were sealed; 0 without
    /// a file.
    pub fn generation_in_file(&self) -> u64 {
        let Ok(text) = std::fs::read_to_string(self.path("calibration.json")) else {
            return 0;
        };
        let values: CalibrationValues = serde_json::from_str(&text).unwrap();
        let generation = (values.steering_offset_rad / offset_rad(1)).round() as u64;
        let document: CalibrationDocument =
            serde_json::from_str(&approved(generation).document).unwrap();
        assert_eq!(values, document.values);
        generation
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

impl Drop for Robot {
    fn drop(&mut self) {
        if let Some(process) = &mut self.process {
            // It may have ended by itself, which a test has seen then.
            process.kill().ok();
            process.wait().ok();
        }
    }
}
