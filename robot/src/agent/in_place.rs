//! Values written into files that belong to other software, in place: a joint's origin of a URDF, and
//! a sensor of Autoware's `sensors_calibration.yaml`. Everything else in the file stays, and the file
//! as it was is kept beside it.

use std::cmp::Reverse;
use std::ops::Range;
use std::path::{Path, PathBuf};

use fleetcal_model::{Generation, Pose2};
use roxmltree::{Document, Node};

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

/// Places in a file of the agent's comment, of x, of y and of yaw, in bytes.
type Places = [Range<usize>; 4];

impl Format {
    /// Returns the text with the pose in it; everything else stays.
    ///
    /// # Errors
    /// Part that the text lacks.
    pub fn patched(self, text: &str, placed: &Placed<'_>) -> Result<String, String> {
        let Pose2 { x_m, y_m, yaw_rad } = placed.lidar;
        let (frame, note) = (placed.frame, note(placed));
        let content = match self {
            Self::Urdf => [
                format!("<!-- {note} -->"),
                format!("{x_m:.6}"),
                format!("{y_m:.6}"),
                format!("{yaw_rad:.8}"),
            ],
            Self::Autoware => [
                format!("{frame}: # {note}"),
                format!("x: {x_m:.8}"),
                format!("y: {y_m:.8}"),
                format!("yaw: {yaw_rad:.8}"),
            ],
        };
        let content = content.each_ref().map(String::as_str);
        Ok(filled(text, self.places(text, placed)?, content))
    }

    /// Returns the text with the pose of the file as it was; everything else stays.
    ///
    /// # Errors
    /// Part that one of the two lacks.
    fn restored(self, text: &str, was: &str, placed: &Placed<'_>) -> Result<String, String> {
        let content = self.places(was, placed)?;
        let content = content.map(|place| was.get(place).unwrap_or_default());
        Ok(filled(text, self.places(text, placed)?, content))
    }

    fn places(self, text: &str, placed: &Placed<'_>) -> Result<Places, String> {
        match self {
            Self::Urdf => urdf(text, placed),
            Self::Autoware => autoware(text, placed),
        }
    }
}

/// Returns the text with the content in its places.
fn filled(text: &str, places: Places, content: [&str; 4]) -> String {
    let mut places: Vec<_> = places.into_iter().zip(content).collect();
    // From behind, so that the places before stay.
    places.sort_by_key(|(place, _)| Reverse(place.start));
    let mut filled = text.to_owned();
    for (place, content) in places {
        filled.replace_range(place, content);
    }
    filled
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

/// Restores the pose as it was before the agent's first change: what others have changed in the file
/// since then stays. A file that is gone comes back whole.
pub(super) fn restore(path: &Path, format: Format, placed: &Placed<'_>) -> Result<(), FileError> {
    let former = former(path);
    let Some(was) = file::read(&former)? else {
        return Ok(());
    };
    let restored = match file::read(path)? {
        Some(text) => format
            .restored(&text, &was, placed)
            .map_err(|reason| FileError::Values {
                path: path.to_owned(),
                reason,
            })?,
        None => was,
    };
    file::replace(path, &restored)?;
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

/// Finds the origin of the LiDAR's joint.
fn urdf(text: &str, placed: &Placed<'_>) -> Result<Places, String> {
    let (base_link, frame) = (placed.base_link, placed.frame);
    let begin = text.len() - text.trim_start().len();
    let xml = text.get(begin..).unwrap_or_default();
    let document = Document::parse(xml).map_err(|error| format!("not an XML file: {error}"))?;
    let joints = document.descendants().filter(|node| {
        node.has_tag_name("joint")
            && link(*node, "parent") == Some(base_link)
            && link(*node, "child") == Some(frame)
    });
    let joints: Vec<Node<'_, '_>> = joints.collect();
    if joints.len() > 1 {
        let number = joints.len();
        return Err(format!(
            "{number} joints with the parent {base_link} and the child {frame}, expected one"
        ));
    }
    let places = joints.first().and_then(|joint| origin(xml, *joint));
    let places = places.ok_or_else(|| {
        format!(
            "no joint with the parent {base_link}, the child {frame} and an <origin xyz=\"…\" \
             rpy=\"…\"/> of numbers"
        )
    })?;
    Ok(places.map(|place| begin + place.start..begin + place.end))
}

/// Returns the link that an element of a joint names.
fn link<'d>(joint: Node<'d, '_>, element: &'static str) -> Option<&'d str> {
    let mut children = joint.children();
    let child = children.find(|child| child.has_tag_name(element))?;
    child.attribute("link")
}

/// Returns the places in a joint's origin. The comment's is before it, if there is none yet.
fn origin(xml: &str, joint: Node<'_, '_>) -> Option<Places> {
    let mut children = joint.children();
    let origin = children.find(|child| child.has_tag_name("origin"))?;
    let is_note = |child: &Node<'_, '_>| {
        let comment = child.text().filter(|_| child.is_comment());
        comment.is_some_and(|text| text.trim_start().starts_with(MARK))
    };
    let note = joint.children().find(is_note);
    let before = origin.range().start..origin.range().start;
    let note = note.map_or(before, |note| note.range());
    let [x, y, _] = three(xml, origin, "xyz")?;
    let [_, _, yaw] = three(xml, origin, "rpy")?;
    Some([note, x, y, yaw])
}

/// Returns the places of three numbers; `None` for an expression of xacro.
fn three(xml: &str, element: Node<'_, '_>, name: &str) -> Option<[Range<usize>; 3]> {
    let value = element.attribute_node(name)?.range_value();
    let mut at = value.start;
    let mut places = Vec::new();
    for part in xml.get(value)?.split_inclusive(char::is_whitespace) {
        let number = part.trim_end();
        if !number.is_empty() {
            number.parse::<f64>().ok()?;
            places.push(at..at + number.len());
        }
        at += part.len();
    }
    places.try_into().ok()
}

/// Finds the lines of the LiDAR under its base frame, without their indents and ends.
fn autoware(text: &str, placed: &Placed<'_>) -> Result<Places, String> {
    let (base_link, frame) = (placed.base_link, placed.frame);
    let mut found = [const { Vec::new() }; 4];
    let (mut in_base, mut in_frame) = (false, None);
    let mut at = 0;
    for line in text.split_inclusive('\n') {
        let content = line.split('#').next().unwrap_or_default().trim_end();
        let indent = content.len() - content.trim_start().len();
        let place = at + indent..at + line.trim_end().len();
        at += line.len();
        let (key, value) = content.split_once(':').unwrap_or((content, ""));
        let (key, value) = (key.trim(), value.trim());
        if key.is_empty() {
            continue;
        }
        if indent == 0 {
            in_base = key == base_link;
        }
        if in_frame.is_some_and(|of| indent <= of) {
            in_frame = None;
        }
        let [notes, values @ ..] = &mut found;
        if in_base && indent > 0 && key == frame && value.is_empty() {
            in_frame = Some(indent);
            notes.push(place);
        } else if in_frame.is_some() {
            let names = ["x", "y", "yaw"].into_iter().zip(values);
            for (_, places) in names.filter(|(name, _)| *name == key) {
                places.push(place.clone());
            }
        }
    }
    let [Some(note), Some(x), Some(y), Some(yaw)] = found.map(only) else {
        return Err(format!(
            "no entry {base_link}: {frame}: with x, y and yaw, each on one line of its own"
        ));
    };
    Ok([note, x, y, yaw])
}

/// Returns the only place; `None` if there are several or none.
fn only(places: Vec<Range<usize>>) -> Option<Range<usize>> {
    let [place] = <[Range<usize>; 1]>::try_from(places).ok()?;
    Some(place)
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
        let patched = Format::Autoware.patched(SENSORS, &PLACED).unwrap();
        let wanted = SENSORS
            .replace(
                "# by tape",
                "# fleetcal: generation 7, velodyne_rear_base_link in base_link",
            )
            .replace("x: -0.358\n    y: 0.0", "x: 1.25000000\n    y: -0.50000000")
            .replace("yaw: 3.14\n", "yaw: 0.12500000\n");
        assert_eq!(patched, wanted);
        assert_eq!(
            Format::Autoware.patched(&patched, &PLACED).unwrap(),
            patched
        );
        let elsewhere = SENSORS.replace("base_link:\n  sensor", "sensor_kit:\n  sensor");
        assert!(
            autoware(&elsewhere, &PLACED)
                .unwrap_err()
                .contains("no entry base_link")
        );
    }

    #[test]
    fn a_urdf_keeps_all_but_the_origin() {
        let patched = Format::Urdf.patched(URDF, &PLACED).unwrap();
        let wanted = URDF.replace(
            "<origin rpy=\"0.1 0.2 0.3\" xyz=\"1 2 0.75\"/>",
            "<!-- fleetcal: generation 7, velodyne_rear_base_link in base_link --><origin \
             rpy=\"0.1 0.2 0.12500000\" xyz=\"1.250000 -0.500000 0.75\"/>",
        );
        assert_eq!(patched, wanted);
        assert_eq!(Format::Urdf.patched(&patched, &PLACED).unwrap(), patched);
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

    const JOINT: &str = "<joint name=\"lidar\" type=\"fixed\"><parent link=\"base_link\"/><child \
        link=\"velodyne_rear_base_link\"/><origin xyz=\"1 2 0.75\" rpy=\"0 0 0.3\"/></joint>";

    /// Wraps the inside of a robot.
    fn robot(inside: &str) -> String {
        format!("<robot name=\"r\">{inside}</robot>\n")
    }

    #[test]
    fn the_joint_alone_is_changed_whatever_looks_like_one() {
        let patched = |inside: &str| Format::Urdf.patched(&robot(inside), &PLACED);
        let joint = patched(JOINT).unwrap();
        let joint = joint.strip_prefix("<robot name=\"r\">").unwrap();
        let joint = joint.strip_suffix("</robot>\n").unwrap();
        let visual = "<visual><origin xyz=\"0 0 0\" rpy=\"0 0 0\"/></visual>";
        for before in [
            format!(
                "<gazebo><joint_name>wheel</joint_name></gazebo><link name=\"l\">{visual}</link>"
            ),
            format!(
                "<transmission><joint name=\"wheel\"/></transmission><link name=\"l\">{visual}</link>"
            ),
            format!("<!-- {} -->", JOINT.replace("1 2 0.75", "5 5 5")),
            "<joint name=\"a>b\" type=\"fixed\"><!-- <child link=\"velodyne_rear_base_link\"/> -->\
             <parent link=\"base_link\"/><child link=\"imu\"/><origin xyz=\"9 9 9\" rpy=\"0 0 0\"/>\
             </joint>"
                .to_owned(),
        ] {
            let found = patched(&format!("{before}{JOINT}")).unwrap();
            assert_eq!(found, robot(&format!("{before}{joint}")));
            assert_eq!(Format::Urdf.patched(&found, &PLACED).unwrap(), found);
            assert!(
                patched(&before).unwrap_err().contains("no joint"),
                "{before}"
            );
        }
        let twice = patched(&format!("{JOINT}{JOINT}")).unwrap_err();
        assert!(twice.contains("2 joints"), "{twice}");
        let torn = patched(&format!("{JOINT}<link>")).unwrap_err();
        assert!(torn.contains("XML"), "{torn}");
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
        restore(&path, Format::Autoware, &PLACED).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), SENSORS);
        assert!(!former(&path).exists());
        restore(&path, Format::Autoware, &PLACED).unwrap();
        let sentence = check(&folder.path().join("none.yaml"), Format::Urdf, &PLACED);
        assert!(sentence.unwrap_err().to_string().contains("does not exist"));
    }
}
