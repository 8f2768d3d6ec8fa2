//! The JSON Schemas of what commands print: published as they are, and true.

use std::fs;
use std::path::{Path, PathBuf};

use fleetcal_tests::binary;
use serde_json::Value;
use tempfile::TempDir;

use super::openapi::{python, quiet, run};
use super::recorded;

/// Script that validates a document, and expects a missing field to be found.
const VALIDATE: &str = "
import json, sys, jsonschema
schema, document = (json.load(open(path)) for path in sys.argv[1:])
jsonschema.Draft202012Validator.check_schema(schema)
validator = jsonschema.Draft202012Validator(schema)
validator.validate(document)
for field in schema['required']:
    part = {key: value for key, value in document.items() if key != field}
    assert not validator.is_valid(part), field
assert not validator.is_valid({**document, 'schema_version': 0})
";

fn published(command: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../docs/schemas/{command}.json"))
}

#[test]
fn the_published_schemas_are_those_of_the_binary() {
    for command in ["calibrate", "odometry", "doctor"] {
        let printed = binary::run_json(["schema", command]);
        let file: Value =
            serde_json::from_str(&fs::read_to_string(published(command)).unwrap()).unwrap();
        assert_eq!(
            printed, file,
            "run: fleetcal schema {command} > docs/schemas/{command}.json"
        );
    }
}

#[test]
fn what_commands_print_is_as_their_schemas_say() {
    let Some(python) = python() else { return };
    let folder = TempDir::new().unwrap();
    let recording = recorded(&folder, 20.0);
    let recording = recording.to_str().unwrap();
    let vehicle = ["--model", "bicycle", "--wheelbase", "1.2"];
    let calibrate: Vec<_> = ["calibrate", recording, "--json"]
        .into_iter()
        .chain(vehicle)
        .collect();
    let trajectory = folder.path().join("odometry.tum");
    let odometry = [
        "odometry",
        recording,
        "--json",
        "--trajectory",
        trajectory.to_str().unwrap(),
    ];
    for arguments in [calibrate, odometry.to_vec()] {
        let command = arguments[0];
        let printed = binary::run_json(arguments.iter().copied());
        let document = folder.path().join("document.json");
        fs::write(&document, printed.to_string()).unwrap();
        let schema = published(command);
        let said = run(
            &python,
            &[
                "-c".as_ref(),
                VALIDATE.as_ref(),
                schema.as_os_str(),
                document.as_os_str(),
            ],
            &[],
        );
        quiet(&said);
    }
}
