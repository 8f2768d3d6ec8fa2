//! Files beside the applied one: for ROS a URDF origin, the line of a `static_transform_publisher`, node
//! parameters, and places in files of other software, each with the same values, its frames, the generation, and
//! poses in one frame alone; and for a steering controller the curve of the steering.

use std::fmt::Write as _;
use std::path::PathBuf;

use fleetcal_model::{Generation, Pose2, SteeringPoint, SteeringTable, SteeringTableStatus};
use fleetcal_proto::calibration::CalibrationValues;

use super::file::{self, FileError};
use super::in_place::{self, Format, Placed};
use super::state::BesideValues;

/// Comment in every file that the agent may replace.
const MARK: &str = "Written by fleetcal agent, which replaces it";

/// Frames of the vehicle in its ROS software.
#[derive(Debug, Clone, PartialEq)]
pub struct VehicleFrames {
    /// Pose of the rear axle in the vehicle's base frame, overriding documents; `None` uses that of
    /// the document, else the same place.
    pub rear_axle_in_base_link: Option<Pose2>,
    /// Height of the LiDAR over the base frame, m, which is not estimated.
    pub lidar_z_m: f64,
    /// Name of the base frame.
    pub base_link: String,
    /// Name of the LiDAR's frame.
    pub lidar: String,
}

impl Default for VehicleFrames {
    fn default() -> Self {
        Self {
            rear_axle_in_base_link: None,
            lidar_z_m: 0.0,
            base_link: "base_link".to_owned(),
            lidar: "laser".to_owned(),
        }
    }
}

/// Kind of an additional file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OutputKind {
    /// A xacro file whose macro `fleetcal_lidar_origin` is the `<origin>` of the LiDAR's joint.
    UrdfOrigin,
    /// A shell script of one line that runs a `static_transform_publisher`.
    StaticTransform,
    /// Parameters of every node, under `fleetcal`.
    RosParameters,
    /// A URDF of the robot, in which the origin of the LiDAR's joint is replaced.
    UrdfJoint,
    /// Autoware's `sensors_calibration.yaml`, in which the LiDAR's x, y and yaw are replaced.
    AutowareCalibration,
    /// Curve of the steering as CSV: measured angle, true angle, its standard deviation. There is no file while
    /// the calibration in use has no curve.
    SteeringTable,
}

impl OutputKind {
    /// Returns the format of a file that belongs to other software; `None` for the agent's own.
    const fn in_place(self) -> Option<Format> {
        match self {
            Self::UrdfJoint => Some(Format::Urdf),
            Self::AutowareCalibration => Some(Format::Autoware),
            Self::UrdfOrigin
            | Self::StaticTransform
            | Self::RosParameters
            | Self::SteeringTable => None,
        }
    }
}

/// Additional files to write.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Outputs {
    /// Kind and path of each file.
    pub files: Vec<(OutputKind, PathBuf)>,
    /// The vehicle's frames.
    pub frames: VehicleFrames,
}

impl Outputs {
    /// Refuses to begin if two files are the same, including the agent's `own`, or if one belongs
    /// to another program.
    pub(super) fn check(&self, own: &[PathBuf]) -> Result<(), FileError> {
        let mut taken: Vec<PathBuf> = own.iter().map(|path| file::resolved(path)).collect();
        for (kind, path) in &self.files {
            let former = kind.in_place().map(|_| in_place::former(path));
            for path in [path].into_iter().chain(&former) {
                let place = file::resolved(path);
                if taken.contains(&place) {
                    return Err(FileError::Twice { path: path.clone() });
                }
                taken.push(place);
            }
        }
        for (kind, path) in &self.files {
            if let Some(format) = kind.in_place() {
                let placed = self.placed(Pose2::IDENTITY, Generation::FACTORY);
                in_place::check(path, format, &placed)?;
                continue;
            }
            let there = file::read(path)?;
            if there.is_some_and(|text| !text.contains(MARK)) {
                return Err(FileError::NotOurs { path: path.clone() });
            }
        }
        Ok(())
    }

    /// Writes these values, and what came with them, to all files; `None` removes the agent's own files and
    /// restores the pose in the others.
    pub(super) fn write(
        &self,
        values: Option<&CalibrationValues>,
        beside: &BesideValues,
    ) -> Result<(), FileError> {
        let rear_axle = self.rear_axle(beside.rear_axle_in_base_link);
        let placed = |lidar| self.placed(lidar, beside.generation);
        for (kind, path) in &self.files {
            match (values, kind.in_place()) {
                (None, None) => file::remove(path)?,
                (None, Some(format)) => in_place::restore(path, format, &placed(Pose2::IDENTITY))?,
                (Some(values), Some(format)) => {
                    let lidar = lidar_in_base_link(values, rear_axle);
                    in_place::write(path, format, &placed(lidar))?;
                }
                (Some(values), None) => match self.text(*kind, values, beside) {
                    Some(text) if file::read(path)?.as_deref() == Some(text.as_str()) => {}
                    Some(text) => file::replace(path, &text)?,
                    None => file::remove(path)?,
                },
            }
        }
        Ok(())
    }

    fn placed(&self, lidar: Pose2, generation: Generation) -> Placed<'_> {
        Placed {
            lidar,
            base_link: &self.frames.base_link,
            frame: &self.frames.lidar,
            generation,
        }
    }

    fn rear_axle(&self, said: Option<Pose2>) -> Pose2 {
        let given = self.frames.rear_axle_in_base_link;
        given.or(said).unwrap_or_default()
    }

    /// Formats a file; `None` if the document has nothing for it.
    fn text(
        &self,
        kind: OutputKind,
        values: &CalibrationValues,
        beside: &BesideValues,
    ) -> Option<String> {
        let rear_axle = self.rear_axle(beside.rear_axle_in_base_link);
        let lidar = lidar_in_base_link(values, rear_axle);
        let head = self.placed(lidar, beside.generation).in_words();
        match kind {
            OutputKind::UrdfOrigin | OutputKind::UrdfJoint => Some(self.urdf_origin(lidar, &head)),
            OutputKind::StaticTransform => Some(self.static_transform(lidar, &head)),
            OutputKind::RosParameters | OutputKind::AutowareCalibration => {
                Some(self.ros_parameters(values, lidar, beside.generation))
            }
            OutputKind::SteeringTable => beside
                .steering_table
                .map(|table| steering_table(table, beside.generation)),
        }
    }

    fn urdf_origin(&self, lidar: Pose2, head: &str) -> String {
        let Pose2 { x_m, y_m, yaw_rad } = lidar;
        let z_m = self.frames.lidar_z_m;
        format!(
            "<?xml version=\"1.0\"?>\n<!-- {MARK}. {head} -->\n\
             <robot xmlns:xacro=\"http://www.ros.org/wiki/xacro\">\n  \
             <xacro:macro name=\"fleetcal_lidar_origin\">\n    \
             <origin xyz=\"{x_m:.6} {y_m:.6} {z_m:.6}\" rpy=\"0 0 {yaw_rad:.8}\"/>\n  \
             </xacro:macro>\n</robot>\n"
        )
    }

    fn static_transform(&self, lidar: Pose2, head: &str) -> String {
        let Pose2 { x_m, y_m, yaw_rad } = lidar;
        let VehicleFrames {
            lidar_z_m,
            base_link,
            lidar,
            ..
        } = &self.frames;
        format!(
            "#!/bin/sh\n# {MARK}. {head}\n\
             exec ros2 run tf2_ros static_transform_publisher --x {x_m:.6} --y {y_m:.6} \
             --z {lidar_z_m:.6} --yaw {yaw_rad:.8} --pitch 0 --roll 0 --frame-id {base_link} \
             --child-frame-id {lidar}\n"
        )
    }

    /// Formats parameters. Each number has a decimal point: without one ROS takes it for an integer.
    /// The LiDAR's pose is in the base frame alone: read for one another's, two poses misplace it.
    fn ros_parameters(
        &self,
        values: &CalibrationValues,
        lidar: Pose2,
        generation: Generation,
    ) -> String {
        let VehicleFrames {
            base_link,
            lidar: frame,
            ..
        } = &self.frames;
        let mut text = format!(
            "# {MARK}.\n/**:\n  ros__parameters:\n    fleetcal:\n      generation: {generation}\n      \
             frame_id: \"{base_link}\"\n      lidar_frame_id: \"{frame}\"\n"
        );
        let in_base_link = [
            ("lidar_in_base_link_x_m", lidar.x_m),
            ("lidar_in_base_link_y_m", lidar.y_m),
            ("lidar_in_base_link_yaw_rad", lidar.yaw_rad),
        ];
        let others = values
            .fields()
            .filter(|(name, _)| !name.starts_with("lidar_"));
        for (name, value) in others.chain(in_base_link) {
            // Writing into a text cannot fail.
            writeln!(text, "      {name}: {value:.9}").ok();
        }
        text
    }
}

/// Formats a curve of the steering, from the right to the left.
fn steering_table(table: &SteeringTable, generation: Generation) -> String {
    let mut text = format!(
        "# {MARK}. Generation {generation}. For information, left positive.\n{}\n\
         measured_rad,true_rad,sigma_rad\n",
        steering_status(table)
    );
    for point in &table.points {
        let SteeringPoint {
            measured_rad,
            true_rad,
            sigma_rad,
        } = point;
        // Writing into a text cannot fail.
        writeln!(text, "{measured_rad:.8},{true_rad:.8},{sigma_rad:.8}").ok();
    }
    text
}

/// Writes the comment of a curve's status, as the dashboard's file has it, too.
fn steering_status(table: &SteeringTable) -> String {
    let status = match table.status {
        SteeringTableStatus::NotKnown => "not_known",
        SteeringTableStatus::Informative => "informative",
        SteeringTableStatus::Converged => "converged",
    };
    match &table.needs {
        // A comment is one line.
        Some(needs) => {
            let needs = needs.replace(char::is_control, " ");
            format!("# Status: {status}. Missing: {needs}.")
        }
        None => format!("# Status: {status}."),
    }
}

fn lidar_in_base_link(values: &CalibrationValues, rear_axle: Pose2) -> Pose2 {
    rear_axle.compose(&Pose2 {
        x_m: values.lidar_x_m,
        y_m: values.lidar_y_m,
        yaw_rad: values.lidar_yaw_rad,
    })
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;
    use std::fs;
    use std::path::Path;

    use super::*;

    const GENERATION: Generation = Generation(7);

    fn values() -> CalibrationValues {
        CalibrationValues {
            steering_offset_rad: -1e-7,
            lidar_x_m: 1.0,
            lidar_y_m: 0.25,
            lidar_yaw_rad: 0.0,
            ..CalibrationValues::default()
        }
    }

    fn beside(rear_axle_in_base_link: Option<Pose2>) -> BesideValues<'static> {
        BesideValues {
            generation: GENERATION,
            rear_axle_in_base_link,
            steering_table: None,
        }
    }

    #[test]
    fn a_steering_table_is_there_as_long_as_the_calibration_in_use_has_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("steering.csv");
        let outputs = Outputs {
            files: vec![(OutputKind::SteeringTable, path.clone())],
            frames: VehicleFrames::default(),
        };
        let points = [[-0.25, -0.2525, 0.001], [0.5, 0.5, 0.0005]];
        let table = SteeringTable {
            status: SteeringTableStatus::Informative,
            needs: Some("turns to\nthe right".to_owned()),
            points: points
                .map(|[measured_rad, true_rad, sigma_rad]| SteeringPoint {
                    measured_rad,
                    true_rad,
                    sigma_rad,
                })
                .to_vec(),
        };
        let with_table = BesideValues {
            steering_table: Some(&table),
            ..beside(None)
        };
        outputs.write(Some(&values()), &with_table).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        let lines: Vec<_> = text.lines().skip(1).collect();
        assert_eq!(
            lines,
            [
                "# Status: informative. Missing: turns to the right.",
                "measured_rad,true_rad,sigma_rad",
                "-0.25000000,-0.25250000,0.00100000",
                "0.50000000,0.50000000,0.00050000",
            ]
        );
        outputs.check(&[]).unwrap();
        for (values, beside) in [(Some(values()), beside(None)), (None, with_table)] {
            outputs.write(Some(&self::values()), &with_table).unwrap();
            assert!(path.exists());
            outputs.write(values.as_ref(), &beside).unwrap();
            assert!(!path.exists());
        }
    }

    /// Makes outputs with a base frame that is turned to the left: its x is the axle's y.
    fn outputs(folder: &Path) -> Outputs {
        let kinds = [
            (OutputKind::UrdfOrigin, "lidar.xacro"),
            (OutputKind::StaticTransform, "lidar.sh"),
            (OutputKind::RosParameters, "lidar.yaml"),
        ];
        let files = kinds.map(|(kind, name)| (kind, folder.join(name)));
        Outputs {
            files: files.to_vec(),
            frames: VehicleFrames {
                rear_axle_in_base_link: Some(Pose2 {
                    x_m: -0.5,
                    y_m: 0.0,
                    yaw_rad: FRAC_PI_2,
                }),
                lidar_z_m: 0.2,
                ..VehicleFrames::default()
            },
        }
    }

    #[test]
    fn every_file_has_the_pose_in_the_base_frame() {
        let folder = tempfile::tempdir().unwrap();
        let outputs = outputs(folder.path());
        outputs.check(&[]).unwrap();
        // What is given counts more than what a document says.
        let said = Pose2 {
            x_m: 7.0,
            y_m: 7.0,
            yaw_rad: 0.0,
        };
        outputs.write(Some(&values()), &beside(Some(said))).unwrap();
        let text = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
        let origin = "<origin xyz=\"-0.750000 1.000000 0.200000\" rpy=\"0 0 1.57079633\"/>";
        assert!(
            text("lidar.xacro").contains(origin),
            "{}",
            text("lidar.xacro")
        );
        let line = "static_transform_publisher --x -0.750000 --y 1.000000 --z 0.200000 \
                    --yaw 1.57079633 --pitch 0 --roll 0 --frame-id base_link --child-frame-id laser\n";
        assert!(text("lidar.sh").ends_with(line), "{}", text("lidar.sh"));
        let parameters = text("lidar.yaml");
        for wanted in [
            "      steering_offset_rad: -0.000000100\n",
            "      generation: 7\n      frame_id: \"base_link\"\n      lidar_frame_id: \"laser\"\n",
            "      lidar_in_base_link_y_m: 1.000000000\n",
        ] {
            assert!(parameters.contains(wanted), "{parameters}");
        }
        // One frame a file.
        assert!(!parameters.contains(" lidar_x_m"), "{parameters}");
        for name in ["lidar.xacro", "lidar.sh"] {
            let head = "Generation 7, laser in base_link.";
            assert!(text(name).contains(head), "{}", text(name));
        }
        // What it has written it may replace, and take away.
        outputs.check(&[]).unwrap();
        outputs.write(None, &beside(None)).unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_withdrawal_keeps_what_others_changed_since() {
        let folder = tempfile::tempdir().unwrap();
        let urdf = "<robot name=\"r\"><joint name=\"l\" type=\"fixed\">\r\n<parent \
            link=\"base_link\"/><child link=\"laser\"/><origin xyz=\"1.0 2 0.75\" rpy=\"0.1 0 0.3\"/>\
            </joint></robot>";
        let sensors = "base_link:\n  laser: # by tape\n    x: 1.0 # m\n    y: 2\n    z: 0.75\n    \
            yaw: 0.3\nother: 1\n";
        let files = [
            (OutputKind::UrdfJoint, "robot.urdf", urdf),
            (OutputKind::AutowareCalibration, "sensors.yaml", sensors),
        ];
        let path = |name: &str| folder.path().join(name);
        let outputs = Outputs {
            files: files.map(|(kind, name, _)| (kind, path(name))).to_vec(),
            frames: VehicleFrames::default(),
        };
        let read = |name: &str| fs::read_to_string(path(name)).unwrap();
        // An upgrade of the package moves the LiDAR up and adds to the file.
        let upgraded = |text: &str| {
            text.replace("0.75", "0.8")
                .replace("other", "new: 2\nother")
        };
        for upgraded in [str::to_owned, upgraded] {
            for (_, name, text) in files {
                fs::write(path(name), text).unwrap();
            }
            outputs.write(Some(&values()), &beside(None)).unwrap();
            for (_, name, text) in files {
                assert_ne!(read(name), text);
                fs::write(path(name), upgraded(&read(name))).unwrap();
            }
            outputs.write(None, &beside(None)).unwrap();
            for (_, name, text) in files {
                assert_eq!(read(name), upgraded(text));
            }
            assert_eq!(fs::read_dir(folder.path()).unwrap().count(), files.len());
        }
    }

    #[test]
    fn without_a_flag_the_document_says_where_the_rear_axle_is() {
        let folder = tempfile::tempdir().unwrap();
        let mut outputs = outputs(folder.path());
        outputs.frames.rear_axle_in_base_link = None;
        let said = Pose2 {
            x_m: -0.4,
            y_m: 0.0,
            yaw_rad: FRAC_PI_2,
        };
        for (said, origin) in [
            (
                Some(said),
                "xyz=\"-0.650000 1.000000 0.200000\" rpy=\"0 0 1.57079633\"",
            ),
            (
                None,
                "xyz=\"1.000000 0.250000 0.200000\" rpy=\"0 0 0.00000000\"",
            ),
        ] {
            outputs.write(Some(&values()), &beside(said)).unwrap();
            let text = fs::read_to_string(folder.path().join("lidar.xacro")).unwrap();
            assert!(text.contains(origin), "{text}");
        }
    }

    #[test]
    fn no_file_is_written_for_two_purposes() {
        let folder = tempfile::tempdir().unwrap();
        let applied = folder.path().join("applied.yaml");
        let memory = folder.path().join("applied.yaml.agent.json");
        fs::create_dir(folder.path().join("more")).unwrap();
        let link = folder.path().join("link.sh");
        std::os::unix::fs::symlink(&applied, &link).unwrap();
        let own = [applied.clone(), memory.clone()];
        fs::write(&applied, "").unwrap();
        for (first, second) in [
            ("one.yaml", "one.yaml"),
            ("one.yaml", "more/../one.yaml"),
            ("one.yaml", "applied.yaml"),
            ("one.yaml", "link.sh"),
            ("applied.yaml.agent.json", "one.yaml"),
        ] {
            let files = [
                (OutputKind::UrdfOrigin, folder.path().join(first)),
                (OutputKind::RosParameters, folder.path().join(second)),
            ];
            let outputs = Outputs {
                files: files.to_vec(),
                frames: VehicleFrames::default(),
            };
            let sentence = outputs.check(&own).unwrap_err().to_string();
            assert!(sentence.contains("two of the agent's files"), "{sentence}");
        }
    }

    #[test]
    fn somebody_elses_file_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let outputs = outputs(folder.path());
        fs::write(folder.path().join("lidar.xacro"), "<robot/>").unwrap();
        let sentence = outputs.check(&[]).unwrap_err().to_string();
        assert!(sentence.contains("lidar.xacro"), "{sentence}");
        assert!(sentence.contains("move it away"), "{sentence}");
    }
}
