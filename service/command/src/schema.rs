//! `fleetcal schema`: the JSON Schema of what the commands print with `--json`.

use clap::{Args, ValueEnum};
use fleetcal_proto::estimate::CalibrationReport;
use serde_json::{Map, Value, json};
use utoipa::ToSchema;

use crate::CommandError;
use crate::doctor::DoctorReport;
use crate::odometry::OdometrySummary;
use crate::output::print_json;

/// Prefix of references to schemas in OpenAPI.
const OPENAPI_REFERENCE: &str = "#/components/schemas/";
const JSON_SCHEMA_REFERENCE: &str = "#/$defs/";

/// Arguments of `fleetcal schema`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The command whose output the schema describes
    #[arg(value_enum, value_name = "COMMAND")]
    pub of: JsonOutput,
}

/// A command that prints JSON with `--json`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum JsonOutput {
    /// `fleetcal calibrate --json`.
    Calibrate,
    /// `fleetcal odometry --json`.
    Odometry,
    /// `fleetcal doctor --json`.
    Doctor,
}

/// Prints the schema (JSON Schema, draft 2020-12).
///
/// # Errors
/// Standard output cannot be written.
pub fn run(arguments: &Arguments) -> Result<(), CommandError> {
    print_json(&schema_of(arguments.of)?)
}

/// Makes the schema of an output.
///
/// # Errors
/// A part of it cannot be written as JSON, which does not happen.
fn schema_of(output: JsonOutput) -> Result<Value, CommandError> {
    match output {
        JsonOutput::Calibrate => {
            document::<CalibrationReport>("calibrate", CalibrationReport::SCHEMA_VERSION)
        }
        JsonOutput::Odometry => {
            document::<OdometrySummary>("odometry", OdometrySummary::SCHEMA_VERSION)
        }
        JsonOutput::Doctor => document::<DoctorReport>("doctor", DoctorReport::SCHEMA_VERSION),
    }
}

/// Makes the schema of a type as a document of its own: OpenAPI 3.1 describes types in JSON Schema,
/// and only the references point elsewhere.
fn document<T: ToSchema>(command: &str, version: u32) -> Result<Value, CommandError> {
    let mut parts = Vec::new();
    T::schemas(&mut parts);
    let mut definitions = Map::new();
    for (name, part) in parts {
        definitions.insert(name, serde_json::to_value(part)?);
    }
    let mut schema = json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": format!("urn:fleetcal:schema:{command}:{version}"),
        "title": format!("What `fleetcal {command} --json` prints, version {version}"),
        "$defs": definitions,
    });
    if let (Value::Object(schema), Value::Object(own)) =
        (&mut schema, serde_json::to_value(T::schema())?)
    {
        schema.extend(own);
    }
    schema["properties"]["schema_version"] = json!({
        "const": version,
        "description": "Version of this schema. It goes up by one whenever a field is renamed or \
                        removed, or means something else.",
    });
    refer_to_definitions(&mut schema);
    Ok(schema)
}

/// Converts references into the OpenAPI document to references into `$defs`.
fn refer_to_definitions(schema: &mut Value) {
    match schema {
        Value::Object(fields) => {
            for (key, value) in fields {
                match value.as_str() {
                    Some(target) if key == "$ref" => {
                        *value = target
                            .replace(OPENAPI_REFERENCE, JSON_SCHEMA_REFERENCE)
                            .into();
                    }
                    _ => refer_to_definitions(value),
                }
            }
        }
        Value::Array(items) => items.iter_mut().for_each(refer_to_definitions),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whatever_it_refers_to_is_defined_in_it() {
        for output in JsonOutput::value_variants() {
            let schema = schema_of(*output).unwrap();
            let text = schema.to_string();
            assert!(!text.contains(OPENAPI_REFERENCE), "{text}");
            for (at, _) in text.match_indices(JSON_SCHEMA_REFERENCE) {
                let rest = &text[at + JSON_SCHEMA_REFERENCE.len()..];
                let name = rest.split('"').next().unwrap();
                assert!(schema["$defs"].get(name).is_some(), "{name}");
            }
            let required = schema["required"].as_array().unwrap();
            assert!(required.contains(&json!("schema_version")));
        }
    }
}
