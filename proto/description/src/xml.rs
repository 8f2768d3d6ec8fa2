//! The XML of a URDF.

use std::collections::{BTreeMap, BTreeSet};
use std::str::FromStr;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, UnitVector3, Vector3};
use roxmltree::{Document, Node, ParsingOptions};

use crate::urdf::{Control, Joint, JointKind, Round, Urdf};
use crate::{DescriptionRefused, LINKS_MAX, NAME_BYTES_MAX, NODES_MAX, URDF_BYTES_MAX};

/// Reads a URDF and checks that it is whole.
///
/// # Errors
/// See [`DescriptionRefused`].
pub fn read(text: &str) -> Result<Urdf, DescriptionRefused> {
    if text.len() > URDF_BYTES_MAX {
        return Err(DescriptionRefused::TooLarge {
            bytes: text.len(),
            limit: URDF_BYTES_MAX,
        });
    }
    let options = ParsingOptions {
        nodes_limit: NODES_MAX,
        ..ParsingOptions::default()
    };
    let document = Document::parse_with_options(text.trim_start(), options).map_err(|error| {
        DescriptionRefused::NoXml {
            reason: shortened(&error.to_string()),
        }
    })?;
    let robot = document.root_element();
    if robot.tag_name().name() != "robot" {
        return Err(DescriptionRefused::NoRobot {
            element: shortened(robot.tag_name().name()),
        });
    }
    if let Some(template) = document.descendants().find(is_template) {
        return Err(DescriptionRefused::Template {
            element: shortened(template.tag_name().name()),
        });
    }
    let urdf = Urdf {
        links: links(robot)?,
        joints: joints(robot)?,
        controls: controls(robot),
        lidars: lidars(robot),
    };
    urdf.check()?;
    Ok(urdf)
}

fn is_template(node: &Node<'_, '_>) -> bool {
    let namespace = node.tag_name().namespace();
    node.is_element() && namespace.is_some_and(|namespace| namespace.ends_with("xacro"))
}

/// Text of a description that a refusal repeats, bounded.
fn shortened(text: &str) -> String {
    text.chars().take(NAME_BYTES_MAX).collect()
}

fn children<'a, 'i: 'a>(
    node: Node<'a, 'i>,
    name: &'static str,
) -> impl Iterator<Item = Node<'a, 'i>> {
    let is_it = move |child: &Node<'a, 'i>| child.has_tag_name(name);
    node.children().filter(is_it)
}

fn child<'a, 'i: 'a>(node: Node<'a, 'i>, name: &'static str) -> Option<Node<'a, 'i>> {
    children(node, name).next()
}

fn field(of: String, found: Option<&str>, expected: &'static str) -> DescriptionRefused {
    DescriptionRefused::Field {
        field: of,
        found: found.map_or_else(
            || "nothing".to_owned(),
            |text| format!("{:?}", shortened(text)),
        ),
        expected,
    }
}

fn name_of(node: Node<'_, '_>, attribute: &str, of: &str) -> Result<String, DescriptionRefused> {
    let name = node.attribute(attribute);
    match name {
        Some(name) if !name.is_empty() && name.len() <= NAME_BYTES_MAX => Ok(name.to_owned()),
        found => Err(field(
            format!("{of}: {attribute}"),
            found,
            "a name of 1 to 200 bytes",
        )),
    }
}

fn links(robot: Node<'_, '_>) -> Result<BTreeMap<String, Vec<Round>>, DescriptionRefused> {
    let mut links = BTreeMap::new();
    for link in children(robot, "link") {
        let name = name_of(link, "name", "link")?;
        let of = |what| -> Result<Vec<Round>, DescriptionRefused> {
            let shapes = children(link, what).filter_map(|shape| round(shape, &name).transpose());
            shapes.collect()
        };
        let mut shapes = of("collision")?;
        if shapes.is_empty() {
            shapes = of("visual")?;
        }
        if links.insert(name.clone(), shapes).is_some() {
            return Err(field(
                "link: name".to_owned(),
                Some(&name),
                "each name once",
            ));
        }
        if links.len() > LINKS_MAX {
            return Err(DescriptionRefused::TooMany {
                what: "links",
                limit: LINKS_MAX,
            });
        }
    }
    Ok(links)
}

fn round(shape: Node<'_, '_>, link: &str) -> Result<Option<Round>, DescriptionRefused> {
    let Some(geometry) = child(shape, "geometry") else {
        return Ok(None);
    };
    let (form, has_axis) = match (child(geometry, "cylinder"), child(geometry, "sphere")) {
        (Some(cylinder), _) => (cylinder, true),
        (None, Some(sphere)) => (sphere, false),
        (None, None) => return Ok(None),
    };
    let of = format!("link {link:?}");
    let text = form.attribute("radius");
    let radius_m = text.and_then(|text| f64::from_str(text.trim()).ok());
    let radius_m = radius_m.filter(|metres| metres.is_finite() && *metres > 0.0);
    let radius_m = radius_m
        .ok_or_else(|| field(format!("{of}: radius"), text, "a number of metres above 0"))?;
    Ok(Some(Round {
        link_from_shape: origin(shape, &of)?,
        radius_m,
        has_axis,
    }))
}

/// Reads an `origin`; the identity without one.
fn origin(node: Node<'_, '_>, of: &str) -> Result<Isometry3<f64>, DescriptionRefused> {
    let Some(origin) = child(node, "origin") else {
        return Ok(Isometry3::identity());
    };
    let [x, y, z] = three(origin, "xyz", of)?.unwrap_or_default();
    let [roll, pitch, yaw] = three(origin, "rpy", of)?.unwrap_or_default();
    Ok(Isometry3::from_parts(
        Translation3::new(x, y, z),
        UnitQuaternion::from_euler_angles(roll, pitch, yaw),
    ))
}

fn three(
    node: Node<'_, '_>,
    attribute: &str,
    of: &str,
) -> Result<Option<[f64; 3]>, DescriptionRefused> {
    let Some(text) = node.attribute(attribute) else {
        return Ok(None);
    };
    let numbers: Result<Vec<f64>, _> = text.split_whitespace().map(f64::from_str).collect();
    let numbers = numbers
        .ok()
        .filter(|all| all.iter().all(|one| one.is_finite()));
    let numbers = numbers.and_then(|all| <[f64; 3]>::try_from(all).ok());
    let refused = || {
        let of = format!("{of}: {} {attribute}", node.tag_name().name());
        field(of, Some(text), "three numbers")
    };
    numbers.map(Some).ok_or_else(refused)
}

fn joints(robot: Node<'_, '_>) -> Result<Vec<Joint>, DescriptionRefused> {
    let mut joints: Vec<Joint> = Vec::new();
    let mut names = BTreeSet::new();
    for node in children(robot, "joint") {
        let joint = joint(node)?;
        if !names.insert(joint.name.clone()) {
            let of = "joint: name".to_owned();
            return Err(field(of, Some(&joint.name), "each name once"));
        }
        if joints.len() >= LINKS_MAX {
            return Err(DescriptionRefused::TooMany {
                what: "joints",
                limit: LINKS_MAX,
            });
        }
        joints.push(joint);
    }
    Ok(joints)
}

fn joint(node: Node<'_, '_>) -> Result<Joint, DescriptionRefused> {
    let name = name_of(node, "name", "joint")?;
    let of = format!("joint {name:?}");
    let link_of = |end: &'static str| -> Result<String, DescriptionRefused> {
        match child(node, end) {
            Some(end_node) => name_of(end_node, "link", &format!("{of}: {end}")),
            None => Err(field(format!("{of}: {end}"), None, "a link")),
        }
    };
    let kind = match node.attribute("type") {
        Some("continuous") => JointKind::Continuous,
        Some("revolute") => JointKind::Revolute,
        Some(_) => JointKind::Other,
        None => return Err(field(format!("{of}: type"), None, "the kind of joint")),
    };
    let axis = match child(node, "axis") {
        Some(axis) => three(axis, "xyz", &of)?.unwrap_or([1.0, 0.0, 0.0]),
        None => [1.0, 0.0, 0.0],
    };
    let axis = UnitVector3::try_new(Vector3::from(axis), 1e-9);
    let axis = axis.or_else(|| (kind == JointKind::Other).then(Vector3::x_axis));
    let axis =
        axis.ok_or_else(|| field(format!("{of}: axis xyz"), Some("0 0 0"), "a direction"))?;
    Ok(Joint {
        kind,
        parent: link_of("parent")?,
        child: link_of("child")?,
        parent_from_child: origin(node, &of)?,
        axis,
        mimics: child(node, "mimic")
            .and_then(|mimic| mimic.attribute("joint"))
            .map(str::to_owned),
        name,
    })
}

/// Reads the interfaces of `ros2_control`, and the transmissions of its predecessor.
fn controls(robot: Node<'_, '_>) -> BTreeMap<String, Control> {
    let mut controls: BTreeMap<String, Control> = BTreeMap::new();
    for system in ["ros2_control", "transmission"] {
        let joints = children(robot, system).flat_map(|system| children(system, "joint"));
        for joint in joints.take(LINKS_MAX) {
            let Some(name) = joint.attribute("name") else {
                continue;
            };
            let commands =
                children(joint, "command_interface").filter_map(|of| of.attribute("name"));
            let hardware = children(joint, "hardwareInterface").filter_map(|of| of.text());
            let control = controls.entry(name.to_owned()).or_default();
            for interface in commands.chain(hardware) {
                let interface = interface.to_ascii_lowercase();
                control.steers |= interface.contains("position");
                control.drives |= interface.contains("velocity") || interface.contains("effort");
            }
        }
    }
    controls
}

/// Reads the links that have a simulated LiDAR.
fn lidars(robot: Node<'_, '_>) -> BTreeSet<String> {
    let is_lidar = |sensor: &Node<'_, '_>| {
        let kind = sensor.attribute("type").unwrap_or_default();
        sensor.has_tag_name("sensor") && (kind.contains("ray") || kind.contains("lidar"))
    };
    let has_one = |gazebo: &Node<'_, '_>| gazebo.descendants().any(|node| is_lidar(&node));
    let links = children(robot, "gazebo").filter(has_one);
    let names = links.filter_map(|gazebo| gazebo.attribute("reference"));
    names.map(str::to_owned).take(LINKS_MAX).collect()
}
