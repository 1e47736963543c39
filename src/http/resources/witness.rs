//! Reads of surfaces, noted before they are answered.

use axum::http::StatusCode;
use axum::response::Response;

use crate::http::AppState;
use crate::http::wire::error::Result;
use crate::identity::Caller;
use crate::jobs::{Act, AuditOutcome};

/// The response, once the audit trail tells of it. One without content gives nothing away and is not
/// told of.
///
/// # Errors
/// Those of the store: what cannot be noted is not given.
pub(in crate::http) async fn witnessed(
    app: &AppState,
    caller: &Caller,
    (act, object): (Act, &str),
    response: Response,
) -> Result<Response> {
    if matches!(
        response.status(),
        StatusCode::OK | StatusCode::PARTIAL_CONTENT
    ) {
        let acts = app.store.by(caller);
        acts.note(act, object, AuditOutcome::Done).await?;
    }
    Ok(response)
}
