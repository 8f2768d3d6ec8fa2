//! `GET /robots/{id}/history`: how a robot's parameters went.

use axum::Json;
use axum::extract::State;
use axum::response::{IntoResponse, Response};
use fleetcal_domain::limits;
use fleetcal_http::csv;
use fleetcal_model::{Parameter, ParameterStatus, Unit};
use fleetcal_proto::RobotId;
use fleetcal_store::{Cell, History, HistoryQuery, Stretch, unpack_status};
use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use crate::ApiState;
use crate::extract::{self, Parameters, RobotPath, number_within};
use crate::problem::Problem;
use crate::time;

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct HistoryParameters {
    /// Names of parameters with commas between them; all of them unless given.
    #[param(example = "steering_offset,lidar_x")]
    parameter: Option<String>,
    /// Beginning, RFC 3339, by the robot's clock; an hour before `to` unless given.
    #[param(value_type = Option<String>, format = DateTime)]
    from: Option<String>,
    /// End, RFC 3339, by the robot's clock, not part of the span; the latest estimate unless
    /// given.
    #[param(value_type = Option<String>, format = DateTime)]
    to: Option<String>,
    /// At most this many stretches, 2 to 5000; 600 unless given.
    #[param(value_type = Option<u32>)]
    max_points: Option<String>,
    /// `json` or `csv` (to be saved); `json` unless given.
    format: Option<String>,
}

/// A robot's history in columns: entry `i` of every list is about the stretch of `bucket_s`
/// seconds that begins at `time[i]`. Stretches without data are left out: where two times are
/// further apart than `bucket_s`, there is a gap.
#[derive(Debug, Serialize, utoipa::ToSchema)]
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
    /// Mean normalised innovation squared of each stretch.
    nis: Vec<Option<f64>>,
    /// The parameters.
    series: Vec<Series>,
}

/// One parameter's history. Values are null where the parameter was fixed or off.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = HistorySeries)]
struct Series {
    parameter: Parameter,
    /// Unit of the values. A heading goes on beyond half a turn, so that it has no jumps.
    unit: Unit,
    mean: Vec<Option<f64>>,
    min: Vec<Option<f64>>,
    max: Vec<Option<f64>>,
    /// Mean standard deviation.
    sigma: Vec<Option<f64>>,
    /// Status at the end of each stretch.
    status: Vec<Option<ParameterStatus>>,
}

/// Gives how a robot's parameters went, at the finest resolution that fits into `max_points`.
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
    )
)]
pub(super) async fn get_history(
    State(api): State<ApiState>,
    RobotPath(id): RobotPath,
    Parameters(query): Parameters<HistoryParameters>,
) -> Result<Response, Problem> {
    let as_csv = match query.format.as_deref() {
        None | Some("json") => false,
        Some("csv") => true,
        Some(other) => return Err(Problem::refused("format", other, "json or csv")),
    };
    let parameters = match query.parameter.as_deref() {
        None => Parameter::ALL.to_vec(),
        Some(names) => names
            .split(',')
            .map(parameter_named)
            .collect::<Result<_, _>>()?,
    };
    let points = query.max_points.as_deref();
    let range = 2..=limits::HTTP_POINTS_MAX;
    let points_max = number_within("max_points", points, range, limits::HTTP_POINTS_DEFAULT)?;
    let from = extract::time("from", query.from.as_deref())?;
    let to = extract::time("to", query.to.as_deref())?;

    let view = api
        .fleet
        .robot(&id)
        .ok_or_else(|| Problem::robot_unknown(id.as_str()))?;
    let to_s = match (to, view.estimate) {
        (Some(to), _) => to.as_second() + i64::from(to.subsec_nanosecond() > 0),
        (None, Some(estimate)) => estimate.stamp_ns.whole_s() + 1,
        // Of a robot without data there is nothing, whatever the span.
        (None, None) => match api.store.last_second(&id).await? {
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
    let query = HistoryQuery {
        robot: id,
        parameters,
        from_s,
        to_s,
        points_max,
    };
    let history = api.store.history(&query).await?;
    let document = document(query, &history);
    if as_csv {
        let name = format!("{}_history.csv", document.robot);
        return Ok(csv::file(csv::CSV, &name, document.csv()));
    }
    Ok(Json(document).into_response())
}

impl HistoryDocument {
    /// One line for each stretch; empty fields where nothing was estimated.
    fn csv(&self) -> String {
        let mut names = vec!["time".to_owned(), "seconds_of_data".to_owned()];
        for series in &self.series {
            let parameter = series.parameter.name();
            let unit = series.unit.symbol();
            for part in ["mean", "min", "max", "sigma"] {
                names.push(format!("{parameter}_{part} ({unit})"));
            }
        }
        let mut text = csv::line(names.iter().map(String::as_str));
        for (index, (time, count)) in self.time.iter().zip(&self.count).enumerate() {
            let mut fields = vec![time.to_string(), count.to_string()];
            for series in &self.series {
                for column in [&series.mean, &series.min, &series.max, &series.sigma] {
                    let value = column.get(index).copied().flatten();
                    fields.push(value.map_or_else(String::new, |value| value.to_string()));
                }
            }
            text.push_str(&csv::line(fields.iter().map(String::as_str)));
        }
        text
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

fn document(query: HistoryQuery, history: &History) -> HistoryDocument {
    let stretches = &history.stretches;
    let series = query
        .parameters
        .iter()
        .enumerate()
        .map(|(index, &parameter)| series(parameter, index, stretches))
        .collect();
    HistoryDocument {
        robot: query.robot,
        from: time::of_seconds(query.from_s),
        to: time::of_seconds(query.to_s),
        bucket_s: history.bucket_s,
        time: stretches
            .iter()
            .map(|stretch| time::of_seconds(stretch.t_s))
            .collect(),
        count: stretches.iter().map(|stretch| stretch.count).collect(),
        nis: stretches.iter().map(|stretch| stretch.nis).collect(),
        series,
    }
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
            .map(|stretch| unpack_status(stretch.status, parameter))
            .collect(),
    }
}
