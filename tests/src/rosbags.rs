//! Recordings as `rosbags` of `PyPI` reads them, an implementation of ROS 2 recordings of its own.

use std::env;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

/// Script that reads all messages of a recording in its own types, with the definitions of the file
/// alone.
const SCRIPT: &str = r#"
import json, sys
from pathlib import Path
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

topics = {}
empty = get_typestore(Stores.EMPTY)
with AnyReader([Path(sys.argv[1])], default_typestore=empty) as reader:
    for connection in reader.connections:
        qos = connection.ext.offered_qos_profiles
        topics[connection.topic] = {
            "type": connection.msgtype, "format": connection.ext.serialization_format,
            "qos": len(qos), "count": 0, "last": None,
        }
    for connection, log_time, data in reader.messages():
        message = reader.deserialize(data, connection.msgtype)
        topic = topics[connection.topic]
        topic["count"] += 1
        if connection.msgtype == "rcl_interfaces/msg/Log":
            topic["last"] = message.msg
        if connection.msgtype == "fleetcal_msgs/msg/Estimate":
            topic["last"] = json.loads(message.document)
            values = {of.name: of.value for of in message.parameters}
            parameters = topic["last"]["parameters"]
            assert values == {name: parameters[name]["value"] for name in parameters}
        if connection.msgtype == "tf2_msgs/msg/TFMessage":
            topic["last"] = message.transforms[0].child_frame_id
print(json.dumps(topics))
"#;

/// Reads every message of a recording. Returns by topic the type, the serialisation format, the
/// number of messages and what the last says; `None` where `FLEETCAL_PYTHON` names no Python.
///
/// # Panics
/// When `rosbags` cannot read all of it.
pub fn read(path: &Path) -> Option<Value> {
    let Some(python) = env::var_os("FLEETCAL_PYTHON").filter(|python| !python.is_empty()) else {
        eprintln!("skipped: FLEETCAL_PYTHON is not set; `make test` sets it");
        return None;
    };
    let output = Command::new(python)
        .args(["-c", SCRIPT])
        .arg(path)
        .output()
        .expect("Python starts");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{}: {said}", path.display());
    let topics = serde_json::from_slice(&output.stdout);
    Some(topics.expect("the topics are JSON"))
}
