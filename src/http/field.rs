//! The trained field at points of the client: for slices and distances.

use axum::Json;
use axum::body::{Body, to_bytes};
use axum::extract::State;
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};

use super::AppState;
use super::error::{ApiError, Code, Result};
use super::extract::{Id, Members, Query, json};
use super::results::succeeded;
use crate::jobs::JobId;
use crate::reconstruction::network::Model;
use crate::reconstruction::surface::Field;
use crate::reconstruction::vector::{Vec3, scale};

/// Most points of a request.
pub(super) const MAX_POINTS: usize = 100_000;

/// Largest body: [`MAX_POINTS`] of three numbers written out in full, with room for blanks.
const MAX_BODY_BYTES: usize = 16 << 20;

/// Most multiplications of a request: about ten seconds of one core.
const MAX_WORK: usize = 10_000_000_000;

/// POST /v1/jobs/{id}/field
///
/// It changes nothing and its answer is always the same, so there is nothing for an
/// `Idempotency-Key` to remember.
pub(super) async fn evaluate(
    State(app): State<AppState>,
    Id(id): Id<JobId>,
    query: Query,
    body: Body,
) -> Result<Response> {
    query.finish()?;
    let body = to_bytes(body, MAX_BODY_BYTES).await.map_err(|_| {
        let detail = format!("at most {MAX_BODY_BYTES} bytes are read");
        ApiError::new(Code::BodyTooLarge, detail)
    })?;
    let mut members = Members::of(&body)?;
    let points = members.required("points", |value| {
        let points: Vec<Vec3> = json(value)?;
        match points.len() {
            1..=MAX_POINTS => Ok(points),
            count => Err(format!("must have 1 to {MAX_POINTS} points, not {count}")),
        }
    });
    let with_gradients = members.take("gradients", json::<bool>).unwrap_or(false);
    members.finish()?;
    let points = points.unwrap_or_default();
    succeeded(app.store.job(&id).await?)?;
    let model = app.store.model(&id).await?;
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
    let model = Model::decode(model).map_err(ApiError::internal)?;
    let lanes = if with_gradients { 4 } else { 1 };
    let most = MAX_WORK / (lanes * model.parameters.len()).max(1);
    if points.len() > most {
        let detail = format!("a network of this size is evaluated at no more than {most} points");
        return Err(ApiError::fault(Code::RequestInvalid, "/points", detail));
    }
    let Some(network) = model.network() else {
        return Err(ApiError::internal("a model has too few parameters"));
    };
    for point in &mut points {
        *point = model.frame.to_unit(*point);
    }
    let mut values = vec![0.0; points.len()];
    if !with_gradients {
        network
            .values(&points, &mut values)
            .map_err(ApiError::internal)?;
        return Ok(json!({ "values": values }));
    }
    let mut gradients = vec![[0.0; 3]; points.len()];
    network
        .values_and_gradients(&points, &mut values, &mut gradients)
        .map_err(ApiError::internal)?;
    // From the frame of training to the coordinates of the cloud: the chain rule.
    for gradient in &mut gradients {
        *gradient = scale(*gradient, model.frame.scale);
    }
    Ok(json!({ "values": values, "gradients": gradients }))
}
