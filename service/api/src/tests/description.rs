//! OpenAPI document: complete, and consistent with every answer in the tests.

use std::collections::BTreeSet;
use std::sync::LazyLock;

use strum::IntoEnumIterator;

use super::*;
use crate::live_event::EventName;
use crate::openapi;

static DOCUMENT: LazyLock<Value> = LazyLock::new(|| serde_json::to_value(openapi()).unwrap());

/// Every operation with its path and method.
fn operations() -> Vec<(&'static str, &'static str, &'static Value)> {
    let paths = DOCUMENT["paths"].as_object().unwrap();
    paths
        .iter()
        .flat_map(|(path, item)| {
            let methods = item.as_object().unwrap().iter();
            methods.map(move |(method, operation)| (path.as_str(), method.as_str(), operation))
        })
        .collect()
}

/// Target of a `$ref`, or the value itself.
fn resolved(value: &'static Value) -> &'static Value {
    match value["$ref"].as_str() {
        None => value,
        Some(name) => DOCUMENT.pointer(name.trim_start_matches('#')).unwrap(),
    }
}

/// Checks that the document describes an answer: its status and media type. Pages, and answers to
/// other methods, are not operations.
pub(super) fn assert_described(method: &str, uri: &str, answer: &Answer) {
    let path = uri.split('?').next().unwrap();
    let fits = |template: &str| {
        let (asked, known) = (path.split('/'), template.split('/'));
        path.matches('/').count() == template.matches('/').count()
            && asked
                .zip(known)
                .all(|(one, other)| one == other || other == "{id}")
    };
    let method = method.to_lowercase();
    let mut found: Vec<_> = operations()
        .into_iter()
        .filter(|(template, of, _)| *of == method && fits(template))
        .collect();
    // `/proposals/approve` is no proposal's number.
    found.sort_by_key(|(template, ..)| template.contains('{'));
    let Some((template, _, operation)) = found.first() else {
        return;
    };
    let status = answer.status.as_str();
    let told = format!("{method} {template} answered {status}: {}", answer.body);
    let described = &operation["responses"][status];
    assert!(described.is_object(), "not described: {told}");
    let media = answer.header("content-type").split(';').next().unwrap();
    let content = &resolved(described)["content"];
    let is_described = content
        .as_object()
        .is_none_or(|content| content.contains_key(media));
    assert!(is_described, "{media} is not described: {told}");
}

#[test]
fn every_response_has_a_description() {
    let mut responses = 0;
    for (path, method, operation) in operations() {
        for (status, response) in operation["responses"].as_object().unwrap() {
            let description = resolved(response)["description"].as_str().unwrap_or("");
            assert!(!description.is_empty(), "{method} {path} {status}");
            assert!(
                status.parse::<u16>().is_ok(),
                "{method} {path} {status} is vague"
            );
            responses += 1;
        }
    }
    assert!(responses > 300, "{responses}");
}

#[test]
fn every_operation_has_a_name_of_its_own() {
    let mut names = BTreeSet::new();
    for (path, method, operation) in operations() {
        let name = operation["operationId"].as_str().unwrap_or_default();
        assert!(
            !name.is_empty() && names.insert(name),
            "{method} {path}: {name:?}"
        );
    }
}

#[test]
fn every_error_is_a_problem() {
    for (path, method, operation) in operations() {
        for (status, response) in operation["responses"].as_object().unwrap() {
            if status.as_str() < "400" {
                continue;
            }
            let schema = &resolved(response)["content"]["application/problem+json"]["schema"];
            let name = schema["$ref"].as_str();
            let told = format!("{method} {path} {status}");
            assert_eq!(name, Some("#/components/schemas/Problem"), "{told}");
        }
    }
}

#[test]
fn every_reference_resolves() {
    let mut used = Vec::new();
    references(&DOCUMENT, &mut used);
    assert!(used.len() > 400, "{}", used.len());
    for reference in used {
        let pointer = reference.trim_start_matches('#');
        assert!(
            DOCUMENT.pointer(pointer).is_some(),
            "{reference} is not defined"
        );
    }
}

fn references(value: &Value, used: &mut Vec<String>) {
    match value {
        Value::Object(fields) => {
            let reference = fields.get("$ref").and_then(Value::as_str);
            used.extend(reference.map(str::to_owned));
            fields.values().for_each(|value| references(value, used));
        }
        Value::Array(values) => values.iter().for_each(|value| references(value, used)),
        _ => {}
    }
}

#[test]
fn only_public_operations_need_no_credential() {
    for (path, method, operation) in operations() {
        let row = (method.to_uppercase(), path);
        let (_, _, access) = crate::access::TABLE
            .iter()
            .find(|(of_method, of_path, _)| (*of_method, *of_path) == (row.0.as_str(), path))
            .unwrap();
        let is_free = operation["security"] == serde_json::json!([]);
        assert_eq!(
            is_free,
            *access == fleetcal_domain::access::Access::Public,
            "{row:?}"
        );
    }
}

#[test]
fn the_description_of_the_stream_has_every_event() {
    let variants = DOCUMENT["components"]["schemas"]["LiveEvent"]["oneOf"].as_array();
    let described: Vec<&str> = variants
        .unwrap()
        .iter()
        .filter_map(|event| event["properties"]["event"]["enum"][0].as_str())
        .collect();
    let named: Vec<&str> = EventName::iter().map(EventName::as_str).collect();
    assert_eq!(described, named);
    let stream = &DOCUMENT["paths"]["/api/v1/stream"]["get"]["responses"]["200"];
    let schema = &stream["content"]["text/event-stream"]["schema"]["$ref"];
    assert_eq!(schema, "#/components/schemas/LiveEvent");
}
