//! The trained field at points of the client: for slices and distances.

use std::collections::BTreeMap;
use std::fmt::Formatter;

use axum::extract::{Request, State};
use axum::http::HeaderValue;
use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse, Response};
use serde::de::{DeserializeOwned, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;

use crate::http::AppState;
use crate::http::resources::jobs::found::Succeeded;
use crate::http::resources::witness::witnessed;
use crate::http::upload;
use crate::http::upload::bodies::held;
use crate::http::wire::error::{ApiError, Code, Result};
use crate::http::wire::extract::{Fields, NoQuery};
use crate::identity::Caller;
use crate::jobs::Act;
use crate::reconstruction::Model;
use crate::reconstruction::vector::{Vec3, scale};

/// Most points of a request.
pub(in crate::http) const MAX_POINTS: usize = 100_000;

/// Largest body: [`MAX_POINTS`] of three numbers written out in full, with room for blanks.
pub(in crate::http) const MAX_BODY_BYTES: usize = 16 << 20;

/// Most members of a request. Two are known; more are read only to name them in the problem.
const MAX_MEMBERS: usize = 16;

/// Most multiplications of a request: about ten seconds of one core.
const MAX_WORK: usize = 10_000_000_000;

/// POST /v1/jobs/{id}/field
///
/// It changes nothing and its answer is always the same, so there is nothing for an
/// `Idempotency-Key` to remember.
pub(in crate::http) async fn evaluate(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Succeeded(job): Succeeded,
    request: Request,
) -> Result<Response> {
    let body = upload::json(&app, request, MAX_BODY_BYTES).await?;
    let model = app.store.of(&job.tenant).model(&job.id).await?;
    let (model, _) = model.ok_or_else(|| ApiError::not_found("model"))?;
    let _turn = app
        .evaluations
        .acquire()
        .await
        .map_err(ApiError::internal)?;
    // Parsing millions of numbers blocks as well.
    let (answer, place) = upload::blocking(move || {
        let asked = Asked::of(&body)?;
        let answer = answer(&model, asked)?;
        let answer = serde_json::to_vec(&answer).map_err(ApiError::internal)?;
        Ok::<_, ApiError>((answer, body.into_place()))
    })
    .await??;
    let json = HeaderValue::from_static("application/json");
    let response = ([(CONTENT_TYPE, json)], held(answer.into(), place)).into_response();
    witnessed(&app, &caller, (Act::FieldRead, job.id.as_str()), response).await
}

/// What a request asks for.
struct Asked {
    points: Vec<Vec3>,
    with_gradients: bool,
}

impl Asked {
    fn of(body: &[u8]) -> Result<Self> {
        let Object(members) = serde_json::from_slice(body)
            .map_err(|error| ApiError::new(Code::MalformedJson, format!("the body: {error}")))?;
        let mut members = Fields::new(members);
        let mut points = Points::default();
        members.required("points", |raw| points.read(raw));
        if let Some((i, detail)) = points.fault.take() {
            members.fault_within("points", &i.to_string(), detail);
        }
        let with_gradients = members.take("gradients", typed::<bool>).unwrap_or(false);
        members.finish()?;
        Ok(Self {
            points: points.read,
            with_gradients,
        })
    }
}

/// The members of an object as raw text. Parsed into `serde_json` values they would take about 20
/// times the memory.
struct Object<'b>(BTreeMap<String, &'b RawValue>);

impl<'de> Deserialize<'de> for Object<'de> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        deserializer.deserialize_map(Object(BTreeMap::new()))
    }
}

impl<'de> Visitor<'de> for Object<'de> {
    type Value = Self;

    fn expecting(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(mut self, mut map: A) -> std::result::Result<Self, A::Error> {
        while let Some((name, value)) = map.next_entry()? {
            self.0.insert(name, value);
            if self.0.len() > MAX_MEMBERS {
                return Err(A::Error::custom("the object has too many members"));
            }
        }
        Ok(self)
    }
}

/// Points parsed one by one, so that a problem can name the point at fault.
#[derive(Default)]
struct Points {
    read: Vec<Vec3>,
    count: usize,
    /// The first item that is not a point.
    fault: Option<(usize, String)>,
}

impl Points {
    fn read(&mut self, raw: &RawValue) -> std::result::Result<(), String> {
        let mut text = serde_json::Deserializer::from_str(raw.get());
        text.deserialize_seq(&mut *self).map_err(|e| plain(&e))?;
        match self.count {
            1..=MAX_POINTS => Ok(()),
            count => Err(format!("must have 1 to {MAX_POINTS} points, not {count}")),
        }
    }
}

impl<'de> Visitor<'de> for &mut Points {
    type Value = ();

    fn expecting(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        f.write_str("a list of points")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> std::result::Result<(), A::Error> {
        while let Some(raw) = list.next_element::<&RawValue>()? {
            self.count += 1;
            if self.count > MAX_POINTS || self.fault.is_some() {
                continue;
            }
            match typed(raw) {
                Ok(point) => self.read.push(point),
                Err(detail) => self.fault = Some((self.count - 1, detail)),
            }
        }
        Ok(())
    }
}

fn typed<T: DeserializeOwned>(raw: &RawValue) -> std::result::Result<T, String> {
    serde_json::from_str(raw.get()).map_err(|error| plain(&error))
}

/// The message of a parse error without its position, which counts from the start of the value and
/// would mislead.
fn plain(error: &serde_json::Error) -> String {
    let text = error.to_string();
    let end = text.find(" at line ").unwrap_or(text.len());
    text[..end].to_owned()
}

/// The values, and the gradients that were asked for.
#[derive(Serialize)]
struct Answer {
    values: Vec<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    gradients: Option<Vec<Vec3>>,
}

fn answer(model: &[u8], asked: Asked) -> Result<Answer> {
    let Asked {
        mut points,
        with_gradients,
    } = asked;
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
        return Ok(Answer {
            values,
            gradients: None,
        });
    }
    let mut gradients = vec![[0.0; 3]; points.len()];
    field
        .values_and_gradients(&points, &mut values, &mut gradients)
        .map_err(ApiError::internal)?;
    // From the frame of training to the coordinates of the cloud: the chain rule.
    for gradient in &mut gradients {
        *gradient = scale(*gradient, model.frame.scale);
    }
    Ok(Answer {
        values,
        gradients: Some(gradients),
    })
}
