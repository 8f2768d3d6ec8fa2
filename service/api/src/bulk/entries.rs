//! Entries of a registration of many robots: a table in CSV, or a list in JSON.

use std::collections::BTreeSet;

use axum::http::StatusCode;
use fleetcal_domain::limits;
use fleetcal_requests::csv::{self, CsvRow};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::extract::parsed;
use crate::problem::Problem;

/// Columns of a table with lists: semicolons separate the items of a cell.
const LISTS: [&str; 2] = ["tags", "streams.joints.wheels"];
/// Columns of a table with free text, beside topics and their types.
const TEXTS: [&str; 5] = [
    "site",
    "vehicle_type",
    "streams.prefix",
    "streams.joints.steering",
    "streams.joints.steering_right",
];

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
    check_count(body.robots.len())?;
    let numbered = body.robots.into_iter().enumerate();
    let entries = numbered.map(|(index, RobotToRegister { id, config })| Entry {
        line: index + 1,
        id,
        config,
    });
    Ok(entries.collect())
}

/// Reads the entries of a table: its first line has the columns, `id` and the fields of a
/// configuration, with dots between the names of nested ones. An empty cell leaves its field out.
pub(super) fn of_csv(bytes: &[u8]) -> Result<Vec<Entry>, Problem> {
    let text = std::str::from_utf8(bytes);
    let text = text.map_err(|_| refused("expected text in UTF-8"))?;
    let rows = csv::rows(text).map_err(|broken| refused(&broken.to_string()))?;
    let mut rows = rows.into_iter();
    let columns = rows.next().map(|row| row.fields).unwrap_or_default();
    check_columns(&columns)?;
    check_count(rows.len())?;
    rows.map(|row| entry(&columns, row)).collect()
}

/// Entry of a row.
fn entry(columns: &[String], row: CsvRow) -> Result<Entry, Problem> {
    let (line, got, most) = (row.line, row.fields.len(), columns.len());
    if got > most {
        let fault = format!("line {line} has {got} fields, expected {most}");
        return Err(refused(&fault));
    }
    let mut id = String::new();
    let mut config = Map::new();
    let cells = columns.iter().zip(row.fields);
    for (column, cell) in cells.filter(|(_, cell)| !cell.is_empty()) {
        if column == "id" {
            id = cell;
        } else {
            place(&mut config, column, value_of(column, &cell));
        }
    }
    Ok(Entry {
        line,
        id,
        config: Value::Object(config),
    })
}

/// Refuses columns that are no list of fields, each once.
fn check_columns(columns: &[String]) -> Result<(), Problem> {
    if !columns.iter().any(|column| column == "id") {
        let fault = "its first line has no column id, expected id, model, wheelbase_m";
        return Err(refused(fault).of_field("id"));
    }
    let (count, max) = (columns.len(), limits::IMPORT_COLUMNS_MAX);
    if count > max {
        let fault = format!("its first line has {count} columns, expected {max} at most");
        return Err(refused(&fault));
    }
    let mut named = BTreeSet::new();
    for (index, column) in columns.iter().enumerate() {
        let (bytes, max) = (column.len(), limits::IMPORT_COLUMN_BYTES_MAX);
        if bytes > max {
            let number = index + 1;
            let fault =
                format!("the name of column {number} has {bytes} bytes, expected {max} at most");
            return Err(refused(&fault));
        }
        let (parts, max) = (column.split('.').count(), limits::IMPORT_COLUMN_PARTS_MAX);
        if parts > max {
            let fault = format!("column {column} has {parts} parts, expected {max} at most");
            return Err(refused(&fault));
        }
        // A spreadsheet may add columns without a name; a value in one is refused.
        if !named.insert(column.as_str()) && !column.is_empty() {
            let fault = format!("column {column} is there twice, expected each column once");
            return Err(refused(&fault));
        }
    }
    for column in &named {
        let mut outer = column.match_indices('.').map(|(dot, _)| &column[..dot]);
        if let Some(outer) = outer.find(|outer| named.contains(outer)) {
            let fault = format!("columns {outer} and {column} overlap, expected one of them");
            return Err(refused(&fault));
        }
    }
    Ok(())
}

/// Refusal of a table, with its fault.
fn refused(fault: &str) -> Problem {
    let detail = format!("the table: {fault}");
    Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "body_refused", detail)
}

/// Value of a cell: a list or text where its column has one, a number or truth value where it reads
/// as one, else text.
fn value_of(column: &str, cell: &str) -> Value {
    if LISTS.contains(&column) {
        let items = cell.split(';').map(str::trim);
        return items.filter(|item| !item.is_empty()).collect();
    }
    if is_text(column) {
        return Value::from(cell);
    }
    match serde_json::from_str(cell) {
        Ok(value @ (Value::Number(_) | Value::Bool(_))) => value,
        _ => Value::from(cell),
    }
}

/// True if a column has text that may read as a number.
fn is_text(column: &str) -> bool {
    let last = column.rsplit_once('.').map(|(_, last)| last);
    let of_stream = column.starts_with("streams.") && matches!(last, Some("topic" | "type"));
    of_stream || TEXTS.contains(&column)
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

/// Refuses none and too many robots.
fn check_count(count: usize) -> Result<(), Problem> {
    let max = limits::REGISTERED_AT_ONCE_MAX;
    if count == 0 || count > max {
        let detail = format!("{count} robots are named, expected 1 to {max}");
        let status = StatusCode::UNPROCESSABLE_ENTITY;
        return Err(Problem::new(status, "value_refused", detail).of_field("robots"));
    }
    Ok(())
}
