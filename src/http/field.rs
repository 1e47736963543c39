//! The trained field at points of the client: for slices and distances.

use axum::Json;
use axum::extract::{Request, State};
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};

use super::AppState;
use super::error::{ApiError, Code, Result};
use super::extract::{Members, NoQuery, json};
use super::results::Succeeded;
use super::upload;
use crate::reconstruction::Model;
use crate::reconstruction::vector::{Vec3, scale};

/// Most points of a request.
pub(super) const MAX_POINTS: usize = 100_000;

/// Largest body: [`MAX_POINTS`] of three numbers written out in full, with room for blanks.
pub(super) const MAX_BODY_BYTES: usize = 16 << 20;

/// Most multiplications of a request: about ten seconds of one core.
const MAX_WORK: usize = 10_000_000_000;

/// POST /v1/jobs/{id}/field
///
/// It changes nothing and its answer is always the same, so there is nothing for an
/// `Idempotency-Key` to remember.
pub(super) async fn evaluate(
    State(app): State<AppState>,
    _: NoQuery,
    Succeeded(job): Succeeded,
    request: Request,
) -> Result<Response> {
    let body = upload::json(&app, request, MAX_BODY_BYTES).await?;
    let mut members = Members::of(&body)?;
    let points = members.required("points", |value| {
        let points: Vec<Value> = json(value)?;
        match points.len() {
            1..=MAX_POINTS => Ok(points),
            count => Err(format!("must have 1 to {MAX_POINTS} points, not {count}")),
        }
    });
    let points = points.unwrap_or_default().into_iter().enumerate();
    let points: std::result::Result<Vec<Vec3>, _> = points
        .map(|(i, point)| json(point).map_err(|detail| (i, detail)))
        .collect();
    if let Err((i, detail)) = &points {
        members.fault_within("points", &i.to_string(), detail.clone());
    }
    let with_gradients = members.take("gradients", json::<bool>).unwrap_or(false);
    members.finish()?;
    let points = points.unwrap_or_default();
    let model = app.store.model(&job.id).await?;
    let (model, _) = model.ok_or_else(|| ApiError::not_found("model"))?;
    let _turn = app
        .evaluations
        .acquire()
        .await
        .map_err(ApiError::internal)?;
    let answer = move || answer(&model, points, with_gradients);
    let answer = tokio::task::spawn_blocking(answer).await;
    Ok(Json(answer.map_err(ApiError::internal)??).into_response())
}

fn answer(model: &[u8], mut points: Vec<Vec3>, with_gradients: bool) -> Result<Value> {
    let unreadable = |error: &dyn std::fmt::Display| {
        let detail = format!("{error}; retry the job for a network that can be read");
        ApiError::new(Code::ModelUnreadable, detail)
    };
    let model = Model::decode(model).map_err(|error| unreadable(&error))?;
    let lanes = if with_gradients { 4 } else { 1 };
    let most = MAX_WORK / (lanes * model.parameters.len()).max(1);
    if points.len() > most {
        let detail = format!("a network of this size is evaluated at no more than {most} points");
        return Err(ApiError::fault(Code::RequestInvalid, "/points", detail));
    }
    let Some(field) = model.field() else {
        return Err(unreadable(&"the model has too few parameters"));
    };
    for point in &mut points {
        *point = model.frame.to_unit(*point);
    }
    let mut values = vec![0.0; points.len()];
    if !with_gradients {
        field
            .values(&points, &mut values)
            .map_err(ApiError::internal)?;
        return Ok(json!({ "values": values }));
    }
    let mut gradients = vec![[0.0; 3]; points.len()];
    field
        .values_and_gradients(&points, &mut values, &mut gradients)
        .map_err(ApiError::internal)?;
    // From the frame of training to the coordinates of the cloud: the chain rule.
    for gradient in &mut gradients {
        *gradient = scale(*gradient, model.frame.scale);
    }
    Ok(json!({ "values": values, "gradients": gradients }))
}
