//! The training series of a job and its gradient histograms.

use axum::Json;
use axum::extract::State;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::http::{HeaderMap, HeaderValue};
use axum::response::{IntoResponse, Response};
use serde_json::{Map, Value, json};

use crate::http::AppState;
use crate::http::resources::jobs::found::Found;
use crate::http::wire::accept::preferred;
use crate::http::wire::error::{ApiError, Code, Result};
use crate::http::wire::extract::{NoQuery, Query, text};
use crate::jobs::{Job, JobId};
use crate::reconstruction::training::Metrics;

/// Rows read at once.
const PAGE: u32 = 20_000;

/// Fewest points that hold the extremes of every series.
const MIN_POINTS: usize = 16;

/// GET /v1/jobs/{id}/gradients
pub(in crate::http) async fn gradients(
    State(app): State<AppState>,
    _: NoQuery,
    Found(job): Found,
) -> Result<Response> {
    let histograms = app.store.gradients(&job.id).await?;
    Ok(Json(json!({"job_id": job.id, "items": histograms})).into_response())
}

/// GET /v1/jobs/{id}/metrics
pub(in crate::http) async fn metrics(
    State(app): State<AppState>,
    Found(job): Found,
    mut query: Query,
    headers: HeaderMap,
) -> Result<Response> {
    let each_block = query.take("blocks", text::<bool>).unwrap_or(false);
    if each_block {
        query.finish()?;
        return Ok(blocks(&job).into_response());
    }
    let fields = query.take("fields", |list| fields(&list));
    let fields = fields.unwrap_or_else(|| Field::ALL.to_vec());
    let after = query.take("after", text::<u64>).unwrap_or(0);
    let max_points = query.take("max_points", |value| {
        let points = text::<usize>(value)?;
        (points >= MIN_POINTS)
            .then_some(points)
            .ok_or(format!("must be at least {MIN_POINTS}"))
    });
    let format = query.take("format", |name| {
        Format::from_name(&name).ok_or_else(|| "must be json, csv or ndjson".to_owned())
    });
    query.finish()?;
    let format = match format {
        Some(format) => format,
        None => Format::accepted(&headers)?,
    };
    // A long series takes some tens of megabytes while it is written out.
    let _turn = app.series.acquire().await.map_err(ApiError::internal)?;
    let rows = read(&app, &job.id, after).await?;
    let total = rows.len();
    let rows = match max_points {
        Some(points) if points < total => thin(rows, &fields, points),
        _ => rows,
    };
    let body = match format {
        Format::Json => {
            let series: Map<String, Value> = fields
                .iter()
                .map(|field| {
                    let column = rows.iter().map(|row| field.value(row)).collect();
                    (field.name().to_owned(), Value::Array(column))
                })
                .collect();
            let last = rows.last().map(|row| row.evaluation);
            json!({
                "job_id": job.id,
                "status": job.status,
                "rows": total,
                "last_evaluation": last,
                "series": series,
            })
            .to_string()
        }
        Format::Csv => csv(&fields, &rows),
        Format::Ndjson => {
            let mut lines = String::new();
            for row in &rows {
                let pairs = fields.iter();
                let row: Map<_, _> = pairs
                    .map(|field| (field.name().to_owned(), field.value(row)))
                    .collect();
                lines.push_str(&Value::Object(row).to_string());
                lines.push('\n');
            }
            lines
        }
    };
    let content_type = HeaderValue::from_static(format.media_type());
    let no_store = HeaderValue::from_static("no-store");
    Ok((
        [(CONTENT_TYPE, content_type), (CACHE_CONTROL, no_store)],
        body,
    )
        .into_response())
}

/// A list of each block a quantity, as the report has them; none before there is a report, or where there are no
/// blocks.
fn blocks(job: &Job) -> Json<Value> {
    let report = job.report.as_ref();
    let blocks = report
        .and_then(|report| report.get("blocks"))
        .unwrap_or(&Value::Null);
    Json(json!({
        "job_id": job.id,
        "status": job.status,
        "blocks": blocks.get("count").and_then(Value::as_u64).unwrap_or(0),
        "series": blocks.get("each").cloned().unwrap_or_else(|| json!({})),
    }))
}

async fn read(app: &AppState, id: &JobId, mut after: u64) -> Result<Vec<Metrics>> {
    let mut rows = Vec::new();
    loop {
        let page = app.store.metrics(id, after, PAGE).await?;
        let full = page.len() == PAGE as usize;
        rows.extend(page);
        match rows.last() {
            Some(last) if full => after = last.evaluation,
            _ => return Ok(rows),
        }
    }
}

/// A column of the series.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Field {
    Evaluation,
    Iteration,
    Loss,
    ValidationLoss,
    GradientNorm,
    StepLength,
    WeightNorms,
    Blocks,
}

impl Field {
    const ALL: [Self; 8] = [
        Self::Evaluation,
        Self::Iteration,
        Self::Loss,
        Self::ValidationLoss,
        Self::GradientNorm,
        Self::StepLength,
        Self::WeightNorms,
        Self::Blocks,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Evaluation => "evaluation",
            Self::Iteration => "iteration",
            Self::Loss => "loss",
            Self::ValidationLoss => "validation_loss",
            Self::GradientNorm => "gradient_norm",
            Self::StepLength => "step_length",
            Self::WeightNorms => "weight_norms",
            Self::Blocks => "blocks",
        }
    }

    /// Its value in JSON; what is not finite is null.
    fn value(self, row: &Metrics) -> Value {
        match self {
            Self::Evaluation => json!(row.evaluation),
            Self::Iteration => json!(row.iteration),
            Self::WeightNorms => json!(row.weight_norms),
            Self::Blocks => json!(row.blocks),
            _ => json!(self.number(row)),
        }
    }

    /// Its value as a point of a curve; what counts up or has a value a layer is none.
    fn number(self, row: &Metrics) -> Option<f64> {
        match self {
            Self::Loss => Some(row.loss),
            Self::ValidationLoss => row.validation_loss,
            Self::GradientNorm => Some(row.gradient_norm),
            Self::StepLength => Some(row.step_length),
            Self::Evaluation | Self::Iteration | Self::WeightNorms | Self::Blocks => None,
        }
        .filter(|number| number.is_finite())
    }
}

/// The evaluation and what else is asked for, in the order of the columns.
fn fields(list: &str) -> std::result::Result<Vec<Field>, String> {
    let names: Vec<&str> = list.split(',').map(str::trim).collect();
    let unknown = |name: &&&str| !Field::ALL.iter().any(|field| field.name() == **name);
    if let Some(name) = names.iter().find(unknown) {
        let known = Field::ALL.map(Field::name).join(", ");
        return Err(format!("'{name}' is none of {known}"));
    }
    let wanted = |field: &Field| *field == Field::Evaluation || names.contains(&field.name());
    Ok(Field::ALL.into_iter().filter(wanted).collect())
}

/// At most `points` rows: the first, the last, and of each of equal stretches those where a curve
/// among the `fields` has its smallest and largest value, so that no peak of it is lost; without a
/// curve the first of each.
fn thin(rows: Vec<Metrics>, fields: &[Field], points: usize) -> Vec<Metrics> {
    let is_curve = |field: &&Field| rows.iter().any(|row| field.number(row).is_some());
    let curves: Vec<&Field> = fields.iter().filter(is_curve).collect();
    let stretches = ((points - 2) / (2 * curves.len()).max(1)).max(1);
    let length = rows.len().div_ceil(stretches);
    let mut keep = vec![false; rows.len()];
    if let Some(first) = keep.first_mut() {
        *first = true;
    }
    if let Some(last) = keep.last_mut() {
        *last = true;
    }
    for (s, stretch) in rows.chunks(length).enumerate() {
        if curves.is_empty() {
            keep[s * length] = true;
        }
        for field in &curves {
            let values = stretch.iter().map(|row| field.number(row)).enumerate();
            let values: Vec<(usize, f64)> = values.filter_map(|(i, v)| Some((i, v?))).collect();
            let by_value = |a: &&(usize, f64), b: &&(usize, f64)| a.1.total_cmp(&b.1);
            let extremes = [
                values.iter().min_by(by_value),
                values.iter().max_by(by_value),
            ];
            for (i, _) in extremes.into_iter().flatten() {
                keep[s * length + i] = true;
            }
        }
    }
    let kept = rows.into_iter().zip(keep).filter(|(_, keep)| *keep);
    kept.map(|(row, _)| row).collect()
}

/// A head and a line a row; the weight norms have a column a layer.
fn csv(fields: &[Field], rows: &[Metrics]) -> String {
    let layers = rows.iter().map(|row| row.weight_norms.len()).max();
    let layers = layers.unwrap_or(0);
    let head: Vec<String> = fields
        .iter()
        .flat_map(|field| match field {
            Field::WeightNorms => (0..layers).map(|k| format!("weight_norm_{k}")).collect(),
            field => vec![field.name().to_owned()],
        })
        .collect();
    let mut out = head.join(",");
    for row in rows {
        out.push('\n');
        let cells: Vec<String> = fields
            .iter()
            .flat_map(|field| match field {
                Field::WeightNorms => (0..layers)
                    .map(|k| {
                        row.weight_norms
                            .get(k)
                            .map_or(String::new(), f64::to_string)
                    })
                    .collect(),
                field => match field.value(row) {
                    Value::Null => vec![String::new()],
                    value => vec![value.to_string()],
                },
            })
            .collect();
        out.push_str(&cells.join(","));
    }
    out.push('\n');
    out
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Json,
    Csv,
    Ndjson,
}

impl Format {
    fn from_name(name: &str) -> Option<Self> {
        match name {
            "json" => Some(Self::Json),
            "csv" => Some(Self::Csv),
            "ndjson" => Some(Self::Ndjson),
            _ => None,
        }
    }

    fn media_type(self) -> &'static str {
        match self {
            Self::Json => "application/json",
            Self::Csv => "text/csv; charset=utf-8",
            Self::Ndjson => "application/x-ndjson",
        }
    }

    /// What the client likes best; without a wish JSON.
    fn accepted(headers: &HeaderMap) -> Result<Self> {
        let offers = [
            ("application/json", Self::Json),
            ("text/csv", Self::Csv),
            ("application/x-ndjson", Self::Ndjson),
        ];
        preferred(headers, &offers).ok_or_else(|| {
            ApiError::new(
                Code::NotAcceptable,
                "the series is given as application/json, text/csv or application/x-ndjson",
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(evaluation: u64, loss: f64) -> Metrics {
        Metrics {
            iteration: evaluation,
            evaluation,
            loss,
            validation_loss: None,
            gradient_norm: 1.0,
            step_length: f64::INFINITY,
            weight_norms: vec![1.0, 2.5],
            blocks: None,
        }
    }

    #[test]
    fn thinning_keeps_ends_and_peaks() {
        let mut rows: Vec<_> = (1..=10_000).map(|i| row(i, 1.0 / i as f64)).collect();
        rows[5_432].loss = 99.0;
        rows[5_433].loss = -1.0;
        let kept = thin(rows, &Field::ALL, 100);
        assert!(kept.len() <= 100);
        let evaluations: Vec<_> = kept.iter().map(|row| row.evaluation).collect();
        assert!(evaluations.is_sorted());
        for evaluation in [1, 5_433, 5_434, 10_000] {
            assert!(evaluations.contains(&evaluation), "{evaluation}");
        }
    }

    #[test]
    fn only_what_is_asked_for_takes_points() {
        // A zigzag in one field: every row is an extreme of its stretch.
        let rows = || {
            (1..=10_000)
                .map(|i| row(i, f64::from(u32::from(i % 2 == 0))))
                .collect()
        };
        let thinned = |list: &str| thin(rows(), &fields(list).unwrap(), 100).len();
        // Two extremes a stretch; a field that nobody asked for would halve the stretches.
        assert!((98..=100).contains(&thinned("loss")), "{}", thinned("loss"));
        // A field that has no value anywhere takes none either.
        assert_eq!(thinned("loss,validation_loss,step_length"), thinned("loss"));
        // Without a curve rows are left out evenly.
        assert!((98..=100).contains(&thinned("weight_norms")));
    }

    #[test]
    fn a_table_has_a_column_a_layer_and_gaps_for_what_is_missing() {
        let fields = fields("loss, weight_norms,validation_loss,step_length").unwrap();
        assert_eq!(
            csv(&fields, &[row(3, 0.5)]),
            "evaluation,loss,validation_loss,step_length,weight_norm_0,weight_norm_1\n\
             3,0.5,,,1,2.5\n"
        );
    }

    #[test]
    fn unknown_fields_are_named() {
        assert!(fields("loss,los").unwrap_err().contains("'los'"));
    }
}
