//! Values written into files that belong to other software, in place: a joint's origin of a URDF, and
//! a sensor of Autoware's `sensors_calibration.yaml`. Everything else in the file stays, and the file
//! as it was is kept beside it.

use std::path::{Path, PathBuf};

use fleetcal_model::{Generation, Pose2};

use super::file::{self, FileError};

/// Suffix of the file as it was before the agent's first change.
const FORMER_ENDING: &str = ".before_fleetcal";
/// Begin of the comment that names generation and frames.
const MARK: &str = "fleetcal: generation ";

/// Pose of a LiDAR to write: where, and of which calibration.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placed<'p> {
    /// The pose in the base frame.
    pub lidar: Pose2,
    /// Name of the base frame.
    pub base_link: &'p str,
    /// Name of the LiDAR's frame.
    pub frame: &'p str,
    /// Generation of the calibration.
    pub generation: Generation,
}

impl Placed<'_> {
    /// Returns generation and frames in words.
    pub fn in_words(&self) -> String {
        format!(
            "Generation {}, {} in {}.",
            self.generation, self.frame, self.base_link
        )
    }
}

/// Format of a file of other software.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Format {
    /// A URDF, or a xacro file in which numbers stand.
    Urdf,
    /// Autoware's `sensors_calibration.yaml`.
    Autoware,
}

impl Format {
    /// Returns the text with the pose in it; height, roll and pitch stay.
    ///
    /// # Errors
    /// What the text lacks.
    pub fn patched(self, text: &str, placed: &Placed<'_>) -> Result<String, String> {
        match self {
            Self::Urdf => urdf(text, placed),
            Self::Autoware => autoware(text, placed),
        }
    }
}

/// Writes a pose into a file, and keeps the file as it was.
pub(super) fn write(path: &Path, format: Format, placed: &Placed<'_>) -> Result<(), FileError> {
    let text = present(path)?;
    let patched = format
        .patched(&text, placed)
        .map_err(|reason| FileError::Values {
            path: path.to_owned(),
            reason,
        })?;
    if patched == text {
        return Ok(());
    }
    let former = former(path);
    if file::read(&former)?.is_none() {
        file::replace(&former, &text)?;
    }
    file::replace(path, &patched)
}

/// Restores a file as it was before the agent's first change.
pub(super) fn restore(path: &Path) -> Result<(), FileError> {
    let former = former(path);
    let Some(text) = file::read(&former)? else {
        return Ok(());
    };
    file::replace(path, &text)?;
    file::remove(&former)
}

/// Checks that a pose can be written into a file.
pub(super) fn check(path: &Path, format: Format, placed: &Placed<'_>) -> Result<(), FileError> {
    let patched = format.patched(&present(path)?, placed);
    patched.map(|_| ()).map_err(|reason| FileError::NoPlace {
        path: path.to_owned(),
        reason,
    })
}

/// Returns the path of the file as it was.
pub(super) fn former(path: &Path) -> PathBuf {
    file::beside(path, FORMER_ENDING)
}

fn present(path: &Path) -> Result<String, FileError> {
    let text = file::read(path)?;
    text.ok_or_else(|| FileError::NoPlace {
        path: path.to_owned(),
        reason: "the file does not exist".to_owned(),
    })
}

fn note(placed: &Placed<'_>) -> String {
    let Placed {
        base_link,
        frame,
        generation,
        ..
    } = placed;
    format!("{MARK}{generation}, {frame} in {base_link}")
}

/// Replaces x, y and yaw of the LiDAR's joint.
fn urdf(text: &str, placed: &Placed<'_>) -> Result<String, String> {
    let (base_link, frame) = (placed.base_link, placed.frame);
    let lacks = || {
        format!(
            "no joint with the parent {base_link}, the child {frame} and an <origin xyz=\"…\" \
             rpy=\"…\"/> of numbers"
        )
    };
    let mut from = 0;
    while let Some(begin) = text.get(from..).and_then(|rest| rest.find("<joint")) {
        let begin = from + begin;
        let length = text.get(begin..).and_then(|rest| rest.find("</joint>"));
        let end = begin + length.ok_or_else(lacks)?;
        let joint = text.get(begin..end).unwrap_or_default();
        from = end;
        if link(joint, "parent") != Some(base_link) || link(joint, "child") != Some(frame) {
            continue;
        }
        let patched = joint_at(joint, placed).ok_or_else(lacks)?;
        let (before, after) = (text.get(..begin), text.get(end..));
        return Ok([
            before.unwrap_or_default(),
            &patched,
            after.unwrap_or_default(),
        ]
        .concat());
    }
    Err(lacks())
}

/// Returns the link that an element of a joint names.
fn link<'j>(joint: &'j str, element: &str) -> Option<&'j str> {
    let (_, rest) = joint.split_once(&format!("<{element} "))?;
    attribute(rest.split_once('>')?.0, "link").map(|(_, value)| value)
}

/// Returns an attribute's place and value.
fn attribute<'e>(element: &'e str, name: &str) -> Option<(usize, &'e str)> {
    for quote in ['"', '\''] {
        let key = format!("{name}={quote}");
        if let Some(at) = element.find(&key) {
            let begin = at + key.len();
            let (value, _) = element.get(begin..)?.split_once(quote)?;
            return Some((begin, value));
        }
    }
    None
}

/// Returns the joint with the pose in its origin, and with the comment before it.
fn joint_at(joint: &str, placed: &Placed<'_>) -> Option<String> {
    let Pose2 { x_m, y_m, yaw_rad } = placed.lidar;
    let joint = without_note(joint);
    let at = joint.find("<origin")?;
    let length = joint.get(at..)?.find('>')?;
    let origin = joint.get(at..at + length)?;
    let (xyz_at, xyz) = attribute(origin, "xyz")?;
    let (rpy_at, rpy) = attribute(origin, "rpy")?;
    let [_, _, z] = three(xyz)?;
    let [roll, pitch, _] = three(rpy)?;
    let mut replaced = [
        (xyz_at, xyz.len(), format!("{x_m:.6} {y_m:.6} {z}")),
        (rpy_at, rpy.len(), format!("{roll} {pitch} {yaw_rad:.8}")),
    ];
    // From behind, so that the places before stay.
    replaced.sort_by_key(|&(at, ..)| std::cmp::Reverse(at));
    let mut patched = origin.to_owned();
    for (at, length, value) in replaced {
        patched.replace_range(at..at + length, &value);
    }
    let (before, after) = (joint.get(..at)?, joint.get(at + length..)?);
    Some(format!("{before}<!-- {} -->{patched}{after}", note(placed)))
}

/// Removes the comment of a former change.
fn without_note(joint: &str) -> String {
    let begin = joint.find(&format!("<!-- {MARK}"));
    let end = begin.and_then(|at| Some(at + joint.get(at..)?.find("-->")? + 3));
    match begin.zip(end) {
        Some((begin, end)) => {
            let (before, after) = (joint.get(..begin), joint.get(end..));
            [before.unwrap_or_default(), after.unwrap_or_default()].concat()
        }
        None => joint.to_owned(),
    }
}

/// Returns three numbers as they are written; `None` for an expression of xacro.
fn three(text: &str) -> Option<[&str; 3]> {
    let parts: Vec<&str> = text.split_whitespace().collect();
    let parts: [&str; 3] = parts.try_into().ok()?;
    parts
        .iter()
        .all(|part| part.parse::<f64>().is_ok())
        .then_some(parts)
}

/// Replaces x, y and yaw of the LiDAR under its base frame.
fn autoware(text: &str, placed: &Placed<'_>) -> Result<String, String> {
    let Pose2 { x_m, y_m, yaw_rad } = placed.lidar;
    let (base_link, frame) = (placed.base_link, placed.frame);
    let values = [("x", x_m), ("y", y_m), ("yaw", yaw_rad)];
    let mut written = 0;
    let (mut in_base, mut in_frame) = (false, None);
    let mut patched = String::with_capacity(text.len() + 100);
    for line in text.split_inclusive('\n') {
        let content = line.split('#').next().unwrap_or_default().trim_end();
        let indent = content.len() - content.trim_start().len();
        let (key, value) = content.split_once(':').unwrap_or((content, ""));
        let (key, value) = (key.trim(), value.trim());
        if key.is_empty() {
            patched.push_str(line);
            continue;
        }
        if indent == 0 {
            in_base = key == base_link;
        }
        if in_frame.is_some_and(|of| indent <= of) {
            in_frame = None;
        }
        let is_frame = in_base && indent > 0 && key == frame && value.is_empty();
        let new = values.iter().find(|(name, _)| *name == key);
        if is_frame {
            in_frame = Some(indent);
            patched.extend([content, " # ", &note(placed), "\n"]);
        } else if let (Some(_), Some((name, value))) = (in_frame, new) {
            written += 1;
            let before = line.get(..indent).unwrap_or_default();
            let value = format!("{value:.8}");
            patched.extend([before, name, ": ", &value, "\n"]);
        } else {
            patched.push_str(line);
        }
    }
    if written == values.len() {
        return Ok(patched);
    }
    Err(format!(
        "no entry {base_link}: {frame}: with x, y and yaw, each on a line of its own"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLACED: Placed<'_> = Placed {
        lidar: Pose2 {
            x_m: 1.25,
            y_m: -0.5,
            yaw_rad: 0.125,
        },
        base_link: "base_link",
        frame: "velodyne_rear_base_link",
        generation: Generation(7),
    };

    /// As of `autoware_individual_params`.
    const SENSORS: &str = "base_link:\n  sensor_kit_base_link:\n    x: 0.9\n    y: 0.0\n    \
        z: 2.0\n    roll: -0.001\n    pitch: 0.015\n    yaw: -0.0364\n  \
        velodyne_rear_base_link: # by tape\n    x: -0.358\n    y: 0.0\n    z: 1.631\n    \
        roll: -0.02\n    pitch: 0.71\n    yaw: 3.14\n";

    const URDF: &str = "<robot name=\"r\">\n  <joint name=\"other\" type=\"fixed\"><parent \
        link=\"base_link\"/><child link=\"imu\"/><origin xyz=\"9 9 9\" rpy=\"0 0 0\"/></joint>\n  \
        <joint name=\"lidar\" type=\"fixed\">\n    <parent link=\"base_link\"/>\n    <child \
        link='velodyne_rear_base_link'/>\n    <origin rpy=\"0.1 0.2 0.3\" xyz=\"1 2 0.75\"/>\n  \
        </joint>\n</robot>\n";

    #[test]
    fn autowares_file_keeps_all_but_the_pose() {
        let patched = autoware(SENSORS, &PLACED).unwrap();
        let wanted = SENSORS
            .replace(
                "# by tape",
                "# fleetcal: generation 7, velodyne_rear_base_link in base_link",
            )
            .replace("x: -0.358\n    y: 0.0", "x: 1.25000000\n    y: -0.50000000")
            .replace("yaw: 3.14\n", "yaw: 0.12500000\n");
        assert_eq!(patched, wanted);
        assert_eq!(autoware(&patched, &PLACED).unwrap(), patched);
        let elsewhere = SENSORS.replace("base_link:\n  sensor", "sensor_kit:\n  sensor");
        assert!(
            autoware(&elsewhere, &PLACED)
                .unwrap_err()
                .contains("no entry base_link")
        );
    }

    #[test]
    fn a_urdf_keeps_all_but_the_origin() {
        let patched = urdf(URDF, &PLACED).unwrap();
        let wanted = URDF.replace(
            "<origin rpy=\"0.1 0.2 0.3\" xyz=\"1 2 0.75\"/>",
            "<!-- fleetcal: generation 7, velodyne_rear_base_link in base_link --><origin \
             rpy=\"0.1 0.2 0.12500000\" xyz=\"1.250000 -0.500000 0.75\"/>",
        );
        assert_eq!(patched, wanted);
        assert_eq!(urdf(&patched, &PLACED).unwrap(), patched);
        for wrong in [
            URDF.replace("velodyne_rear", "front"),
            URDF.replace("xyz=\"1 2 0.75\"", "xyz=\"${x} 2 0.75\""),
            URDF.replace("<origin rpy=\"0.1 0.2 0.3\" xyz=\"1 2 0.75\"/>", ""),
        ] {
            assert!(
                urdf(&wrong, &PLACED).unwrap_err().contains("no joint"),
                "{wrong}"
            );
        }
    }

    #[test]
    fn the_file_as_it_was_comes_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sensors_calibration.yaml");
        std::fs::write(&path, SENSORS).unwrap();
        check(&path, Format::Autoware, &PLACED).unwrap();
        write(&path, Format::Autoware, &PLACED).unwrap();
        let next = Placed {
            generation: Generation(8),
            ..PLACED
        };
        write(&path, Format::Autoware, &next).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains("generation 8") && !text.contains("generation 7"));
        restore(&path).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), SENSORS);
        assert!(!former(&path).exists());
        restore(&path).unwrap();
        let sentence = check(&folder.path().join("none.yaml"), Format::Urdf, &PLACED);
        assert!(sentence.unwrap_err().to_string().contains("does not exist"));
    }
}
