//! Route `GET /robots/{id}/history`: a robot's parameters over time.

use axum::body::Body;
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use fleetcal_domain::limits;
use fleetcal_http::csv;
use fleetcal_model::{Parameter, ParameterStatus, Unit};
use fleetcal_proto::RobotId;
use fleetcal_store::{Cell, History, HistoryQuery, Stretch};
use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use crate::ApiState;
use crate::access::Caller;
use crate::export::Export;
use crate::extract::{self, Parameters, RobotPath, number_within};
use crate::listing;
use crate::problem::Problem;
use crate::time;

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct HistoryParameters {
    /// Names of parameters, separated by commas; all parameters unless given.
    #[param(example = "steering_offset,lidar_x")]
    parameter: Option<String>,
    /// Beginning, RFC 3339, by the robot's clock; an hour before `to` unless given.
    #[param(value_type = Option<String>, format = DateTime)]
    from: Option<String>,
    /// End, RFC 3339, by the robot's clock, not part of the span; the latest estimate unless given.
    #[param(value_type = Option<String>, format = DateTime)]
    to: Option<String>,
    /// Largest number of stretches, 2 to 5000; 600 unless given.
    #[param(value_type = Option<u32>)]
    max_points: Option<String>,
    /// Format: `json` or `csv` (to be saved); `json` unless given.
    format: Option<String>,
}

/// History of a robot in columns: entry `i` of every list is about the stretch of `bucket_s`
/// seconds that begins at `time[i]`. Stretches without data are absent: two times that are further
/// apart than `bucket_s` show a gap.
#[derive(Serialize, utoipa::ToSchema)]
pub(super) struct HistoryDocument {
    robot: RobotId,
    /// Beginning of the span.
    #[schema(value_type = String, format = DateTime)]
    from: Timestamp,
    /// End of the span, not part of it.
    #[schema(value_type = String, format = DateTime)]
    to: Timestamp,
    /// Length of a stretch, s.
    bucket_s: i64,
    /// Beginning of each stretch, by the robot's clock.
    #[schema(value_type = Vec<String>, format = DateTime)]
    time: Vec<Timestamp>,
    /// Seconds of data in each stretch.
    count: Vec<u32>,
    /// Mean normalised innovation squared of each stretch, with the noise as configured.
    nis: Vec<Option<f64>>,
    /// Histories of the parameters.
    series: Vec<Series>,
}

/// History of one parameter. Values are null while the parameter was fixed or off.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = HistorySeries)]
struct Series {
    parameter: Parameter,
    /// Unit of the values. A heading continues beyond half a turn, so that it has no jumps.
    unit: Unit,
    mean: Vec<Option<f64>>,
    min: Vec<Option<f64>>,
    max: Vec<Option<f64>>,
    /// Mean standard deviation.
    sigma: Vec<Option<f64>>,
    /// Status at the end of each stretch.
    status: Vec<Option<ParameterStatus>>,
}

/// Returns the history of a robot's parameters, at the finest resolution that fits into
/// `max_points`.
///
/// Extremes survive: each stretch has its lowest and highest value.
#[utoipa::path(
    get,
    path = "/robots/{id}/history",
    tag = "robots",
    params(("id" = RobotId, Path, description = "The robot."), HistoryParameters),
    responses(
        (status = OK, description = "The history; with `format=csv` a file",

            content((HistoryDocument = "application/json"), (String = "text/csv"))),
        (status = NOT_FOUND, description = "The robot is unknown"),
        (status = TOO_MANY_REQUESTS,
            description = "Too many files are written for the user or token"),
        (status = SERVICE_UNAVAILABLE,
            description = "Too many files are written, or the database is unavailable"),
    )
)]
pub(super) async fn get_history(
    State(api): State<ApiState>,
    RobotPath(id): RobotPath,
    Parameters(query): Parameters<HistoryParameters>,
    caller: Caller,
) -> Result<Response, Problem> {
    let as_csv = match query.format.as_deref() {
        None | Some("json") => false,
        Some("csv") => true,
        Some(other) => return Err(Problem::refused("format", other, "json or csv")),
    };
    let parameters = parameters_of(query.parameter.as_deref())?;
    let points = query.max_points.as_deref();
    let range = 2..=limits::HTTP_POINTS_MAX;
    let points_max = number_within("max_points", points, range, limits::HTTP_POINTS_DEFAULT)?;
    let (from_s, to_s) = span_of(&api, &id, &query).await?;
    let query = HistoryQuery {
        robot: id,
        parameters,
        from_s,
        to_s,
        points_max,
    };
    let export = as_csv.then(|| Export::begin(&api, caller)).transpose()?;
    let history = HistoryText {
        history: api.store.history(&query).await?,
        query,
    };
    Ok(if let Some(export) = export {
        let name = format!("{}_history.csv", history.query.robot);
        let lines = listing::pieces(history.csv_pieces(), move |piece| Ok(history.csv(piece)));
        csv::file(csv::CSV, &name, export.body(lines))
    } else {
        let pieces = history.json_pieces();
        let body = Body::from_stream(listing::pieces(pieces, move |piece| history.json(piece)));
        ([(header::CONTENT_TYPE, "application/json")], body).into_response()
    })
}

/// Parameters of these names, each once: a header has room for thousands.
fn parameters_of(names: Option<&str>) -> Result<Vec<Parameter>, Problem> {
    let Some(names) = names else {
        return Ok(Parameter::ALL.to_vec());
    };
    let mut parameters = Vec::new();
    for name in names.split(',') {
        let parameter = parameter_named(name)?;
        if parameters.contains(&parameter) {
            return Err(Problem::refused("parameter", name, "each name once"));
        }
        parameters.push(parameter);
    }
    Ok(parameters)
}

/// Requested begin and end, s.
async fn span_of(
    api: &ApiState,
    id: &RobotId,
    query: &HistoryParameters,
) -> Result<(i64, i64), Problem> {
    let from = extract::time("from", query.from.as_deref())?;
    let to = extract::time("to", query.to.as_deref())?;
    let view = api
        .fleet
        .robot(id)
        .ok_or_else(|| Problem::robot_unknown(id.as_str()))?;
    let to_s = match (to, view.estimate) {
        (Some(to), _) => to.as_second() + i64::from(to.subsec_nanosecond() > 0),
        (None, Some(estimate)) => estimate.stamp_ns.whole_s() + 1,
        // Of a robot without data there is nothing, whatever the span.
        (None, None) => match api.store.last_second(id).await? {
            Some(last_s) => last_s + 1,
            None => api.clock.now().whole_s() + 1,
        },
    };
    let from_s = match from {
        Some(from) => from.as_second(),
        None => to_s.saturating_sub(limits::HTTP_HISTORY_SPAN_DEFAULT_S),
    };
    if from_s > to_s {
        let given = time::of_seconds(from_s).to_string();
        let accepted = format!("a time before `to`, {}", time::of_seconds(to_s));
        return Err(Problem::refused("from", &given, &accepted));
    }
    Ok((from_s, to_s))
}

/// History whose text is written piece by piece: that of all parameters has megabytes.
struct HistoryText {
    query: HistoryQuery,
    history: History,
}

/// Lines of a table in one piece.
const LINES_AT_ONCE: usize = limits::LIST_ROWS_AT_ONCE as usize;

impl HistoryText {
    /// Number of pieces of JSON: one before those of the parameters, and one after them.
    fn json_pieces(&self) -> usize {
        self.query.parameters.len() + 2
    }

    /// Piece of the [`HistoryDocument`].
    fn json(&self, piece: usize) -> serde_json::Result<String> {
        let Some(index) = piece.checked_sub(1) else {
            return self.json_head();
        };
        let Some(&parameter) = self.query.parameters.get(index) else {
            return Ok("]}".to_owned());
        };
        let series = series(parameter, index, &self.history.stretches);
        let comma = if index == 0 { "" } else { "," };
        Ok(format!("{comma}{}", serde_json::to_string(&series)?))
    }

    /// Begin of the JSON, up to the parameters.
    fn json_head(&self) -> serde_json::Result<String> {
        let HistoryQuery {
            robot,
            from_s,
            to_s,
            ..
        } = &self.query;
        let stretches = &self.history.stretches;
        let time: Vec<_> = stretches
            .iter()
            .map(|one| time::of_seconds(one.t_s))
            .collect();
        let count: Vec<_> = stretches.iter().map(|one| one.count).collect();
        let nis: Vec<_> = stretches.iter().map(|one| one.nis).collect();
        Ok(format!(
            "{{\"robot\":{},\"from\":{},\"to\":{},\"bucket_s\":{},\"time\":{},\"count\":{},\
             \"nis\":{},\"series\":[",
            serde_json::to_string(robot)?,
            serde_json::to_string(&time::of_seconds(*from_s))?,
            serde_json::to_string(&time::of_seconds(*to_s))?,
            self.history.bucket_s,
            serde_json::to_string(&time)?,
            serde_json::to_string(&count)?,
            serde_json::to_string(&nis)?,
        ))
    }

    /// Number of pieces of the table: the line of names, and lines of stretches.
    fn csv_pieces(&self) -> usize {
        1 + self.history.stretches.len().div_ceil(LINES_AT_ONCE)
    }

    /// Piece of the table with one line for each stretch; fields without an estimate are empty.
    fn csv(&self, piece: usize) -> String {
        let Some(chunk) = piece.checked_sub(1) else {
            return self.csv_names();
        };
        let lines = self.history.stretches.chunks(LINES_AT_ONCE).nth(chunk);
        let lines = lines.unwrap_or_default();
        lines.iter().map(|one| self.csv_line(one)).collect()
    }

    fn csv_names(&self) -> String {
        let mut names = vec!["time".to_owned(), "seconds_of_data".to_owned()];
        for parameter in &self.query.parameters {
            let (name, unit) = (parameter.name(), parameter.unit().symbol());
            for part in ["mean", "min", "max", "sigma"] {
                names.push(format!("{name}_{part} ({unit})"));
            }
        }
        names.push("nis".to_owned());
        csv::line(names.iter().map(String::as_str))
    }

    fn csv_line(&self, stretch: &Stretch) -> String {
        let time = time::of_seconds(stretch.t_s).to_string();
        let mut fields = vec![time, stretch.count.to_string()];
        for index in 0..self.query.parameters.len() {
            let cell = stretch.cells.get(index).and_then(Option::as_ref);
            let values = cell.map(|cell| [cell.mean, cell.min, cell.max, cell.sigma]);
            fields.extend(match values {
                Some(values) => values.map(|value| value.to_string()),
                None => [const { String::new() }; 4],
            });
        }
        fields.push(stretch.nis.map(|nis| nis.to_string()).unwrap_or_default());
        csv::line(fields.iter().map(String::as_str))
    }
}

fn parameter_named(name: &str) -> Result<Parameter, Problem> {
    Parameter::ALL
        .into_iter()
        .find(|parameter| parameter.name() == name)
        .ok_or_else(|| {
            let accepted = Parameter::ALL.map(Parameter::name).join(", ");
            Problem::refused("parameter", name, &format!("some of {accepted}"))
        })
}

fn series(parameter: Parameter, index: usize, stretches: &[Stretch]) -> Series {
    let column = |value: fn(&Cell) -> f64| {
        stretches
            .iter()
            .map(|stretch| stretch.cells.get(index)?.as_ref().map(value))
            .collect::<Vec<Option<f64>>>()
    };
    Series {
        parameter,
        unit: parameter.unit(),
        mean: column(|cell| cell.mean),
        min: column(|cell| cell.min),
        max: column(|cell| cell.max),
        sigma: column(|cell| cell.sigma),
        status: stretches
            .iter()
            .map(|stretch| stretch.status.get(parameter))
            .collect(),
    }
}
