//! The training series of a job and its gradient histograms.

use axum::Json;
use axum::extract::State;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::http::{HeaderMap, HeaderValue};
use axum::response::{IntoResponse, Response};
use serde_json::{Map, Value};

use crate::http::AppState;
use crate::http::api;
use crate::http::resources::jobs::found::Found;
use crate::http::wire::accept::preferred;
use crate::http::wire::error::{ApiError, Code, Result};
use crate::http::wire::extract::{NoQuery, Query, text, whole};
use crate::jobs::Job;
use crate::reconstruction::training::{Column, Metrics, csv};

/// Rows read at once.
const PAGE: u32 = 20_000;

/// Fewest points in which the extremes of every column fit.
const MIN_POINTS: usize = 16;

/// GET /v1/jobs/{id}/gradients
pub(in crate::http) async fn gradients(
    State(app): State<AppState>,
    _: NoQuery,
    Found(job): Found,
) -> Result<Response> {
    let body = api::JobItems {
        job_id: &job.id,
        items: app.store.of(&job.tenant).gradients(&job.id).await?,
    };
    Ok(Json(body).into_response())
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
    let fields = fields.unwrap_or_else(|| Column::ALL.to_vec());
    let after = query.take("after", whole).unwrap_or(0);
    let max_points = query.take("max_points", |value| {
        let points = whole(value)? as usize;
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
    let rows = read(&app, &job, after).await?;
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
            let body = api::Series {
                job_id: &job.id,
                status: job.status,
                rows: total,
                last_evaluation: rows.last().map(|row| row.evaluation),
                series,
            };
            serde_json::to_string(&body).map_err(ApiError::internal)?
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

/// One list for each quantity, with a value for each block, from the report. Empty before there is a
/// report, and without blocks.
fn blocks(job: &Job) -> Json<api::Blocks<'_>> {
    let report = job.report.as_ref();
    let blocks = report
        .and_then(|report| report.get("blocks"))
        .unwrap_or(&Value::Null);
    Json(api::Blocks {
        job_id: &job.id,
        status: job.status,
        blocks: blocks.get("count").and_then(Value::as_u64).unwrap_or(0),
        series: blocks
            .get("each")
            .cloned()
            .unwrap_or_else(|| Map::new().into()),
    })
}

async fn read(app: &AppState, job: &Job, mut after: u64) -> Result<Vec<Metrics>> {
    let records = app.store.of(&job.tenant);
    let mut rows = Vec::new();
    loop {
        let page = records.metrics(&job.id, after, PAGE).await?;
        let full = page.len() == PAGE as usize;
        rows.extend(page);
        match rows.last() {
            Some(last) if full => after = last.evaluation,
            _ => return Ok(rows),
        }
    }
}

/// The evaluation and what else is asked for, in the order of the columns.
fn fields(list: &str) -> std::result::Result<Vec<Column>, String> {
    let names: Vec<&str> = list.split(',').map(str::trim).collect();
    let unknown = |name: &&&str| !Column::ALL.iter().any(|field| field.name() == **name);
    if let Some(name) = names.iter().find(unknown) {
        let known = Column::ALL.map(Column::name).join(", ");
        return Err(format!("'{name}' is none of {known}"));
    }
    let wanted = |field: &Column| *field == Column::Evaluation || names.contains(&field.name());
    Ok(Column::ALL.into_iter().filter(wanted).collect())
}

/// Thins the series to at most `points` rows without losing a peak: the first row, the last, and
/// from each of equal stretches the rows where one of the curves among `fields` is smallest or
/// largest. Without a curve, the first row of each stretch.
fn thin(rows: Vec<Metrics>, fields: &[Column], points: usize) -> Vec<Metrics> {
    let is_curve = |field: &&Column| rows.iter().any(|row| field.number(row).is_some());
    let curves: Vec<&Column> = fields.iter().filter(is_curve).collect();
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

    /// The format that the client prefers; JSON by default.
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
        let kept = thin(rows, &Column::ALL, 100);
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
    fn unknown_fields_are_named() {
        assert!(fields("loss,los").unwrap_err().contains("'los'"));
    }
}
