//! Entries of a registration of many robots: a table in CSV, or a list in JSON.

use std::collections::BTreeMap;

use axum::http::StatusCode;
use fleetcal_domain::limits;
use fleetcal_requests::csv;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::extract::parsed;
use crate::problem::Problem;

/// Robots to register.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[schema(as = RobotsToRegister)]
#[serde(deny_unknown_fields)]
pub(super) struct ImportBody {
    /// Robots, 1 to 1000, each once.
    robots: Vec<RobotToRegister>,
}

/// Robot to register.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
struct RobotToRegister {
    /// Robot's id.
    id: String,
    /// Configuration, as in `PUT /robots/{id}`.
    #[schema(value_type = fleetcal_domain::robot::RobotConfig)]
    config: Value,
}

/// Entry as it was sent.
#[derive(Debug)]
pub(super) struct Entry {
    /// Line of the table, or number of the entry in the list; from 1.
    pub(super) line: usize,
    /// Id of the robot.
    pub(super) id: String,
    /// Configuration of the robot.
    pub(super) config: Value,
}

/// Wrong line of a registration.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct WrongLine {
    /// Line of the table, or number of the entry in the list; from 1.
    pub(super) line: usize,
    /// Id in that line.
    pub(super) robot: String,
    /// Column, with dots between the names of nested fields; absent if the whole line is wrong.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) field: Option<String>,
    /// Refused value; absent if there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    pub(super) value: Option<Value>,
    /// Fault, and what is expected.
    pub(super) detail: String,
}

impl Entry {
    /// Reports that the entry is wrong.
    pub(super) fn wrong(&self, problem: &Problem) -> WrongLine {
        let value = match problem.field() {
            Some("id") => Some(Value::from(self.id.clone())),
            Some(field) => {
                let pointer = format!("/{}", field.replace('.', "/"));
                self.config.pointer(&pointer).cloned()
            }
            None => None,
        };
        WrongLine {
            line: self.line,
            robot: self.id.clone(),
            field: problem.field().map(str::to_owned),
            value,
            detail: problem.detail().to_owned(),
        }
    }
}

/// Reads the entries of a list in JSON.
pub(super) fn of_json(bytes: &[u8]) -> Result<Vec<Entry>, Problem> {
    let body: ImportBody = parsed(bytes)?;
    let numbered = body.robots.into_iter().enumerate();
    let entries = numbered.map(|(index, RobotToRegister { id, config })| Entry {
        line: index + 1,
        id,
        config,
    });
    limited(entries.collect())
}

/// Reads the entries of a table: its first line has the columns, `id` and the fields of a
/// configuration, with dots between the names of nested ones. An empty cell leaves its field out.
pub(super) fn of_csv(bytes: &[u8]) -> Result<Vec<Entry>, Problem> {
    let refused =
        |detail: String| Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "body_refused", detail);
    let text = std::str::from_utf8(bytes);
    let text = text.map_err(|_| refused("the table: expected text in UTF-8".to_owned()))?;
    let rows = csv::rows(text).map_err(|broken| refused(format!("the table: {broken}")))?;
    let mut rows = rows.into_iter();
    let columns = rows.next().map(|row| row.fields).unwrap_or_default();
    if !columns.iter().any(|column| column == "id") {
        let detail = "the table: its first line has no column id, expected id, model, wheelbase_m";
        return Err(refused(detail.to_owned()).of_field("id"));
    }
    let mut entries = Vec::new();
    for row in rows {
        if row.fields.len() > columns.len() {
            let (got, most) = (row.fields.len(), columns.len());
            let line = row.line;
            let detail = format!("the table: line {line} has {got} fields, expected {most}");
            return Err(refused(detail));
        }
        let mut cells: BTreeMap<_, _> = columns.iter().zip(row.fields).collect();
        let id = cells.remove(&"id".to_owned()).unwrap_or_default();
        let mut config = Map::new();
        for (column, cell) in cells.into_iter().filter(|(_, cell)| !cell.is_empty()) {
            place(&mut config, column, value_of(&cell));
        }
        entries.push(Entry {
            line: row.line,
            id,
            config: Value::Object(config),
        });
    }
    limited(entries)
}

/// Value of a cell: a number or truth value where it reads as one, else text.
fn value_of(cell: &str) -> Value {
    match serde_json::from_str(cell) {
        Ok(value @ (Value::Number(_) | Value::Bool(_))) => value,
        _ => Value::from(cell),
    }
}

/// Places a value at the path of a column.
fn place(config: &mut Map<String, Value>, column: &str, value: Value) {
    match column.split_once('.') {
        None => {
            config.insert(column.to_owned(), value);
        }
        Some((outer, inner)) => {
            let nested = config.entry(outer).or_insert_with(|| Map::new().into());
            if let Value::Object(nested) = nested {
                place(nested, inner, value);
            }
        }
    }
}

fn limited(entries: Vec<Entry>) -> Result<Vec<Entry>, Problem> {
    let (count, max) = (entries.len(), limits::REGISTERED_AT_ONCE_MAX);
    if count == 0 || count > max {
        let detail = format!("{count} robots are named, expected 1 to {max}");
        let status = StatusCode::UNPROCESSABLE_ENTITY;
        return Err(Problem::new(status, "value_refused", detail).of_field("robots"));
    }
    Ok(entries)
}
