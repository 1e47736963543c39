//! Jobs: submitted, listed, described, cancelled, tried again, erased.
use super::AppState;
use super::error::{ApiError, Result};
use axum::extract::State;
pub(super) async fn create(State(_): State<AppState>) -> Result<()> {
    Err(ApiError::not_found("route"))
}
pub(super) async fn list(State(_): State<AppState>) -> Result<()> {
    Err(ApiError::not_found("route"))
}
pub(super) async fn show(State(_): State<AppState>) -> Result<()> {
    Err(ApiError::not_found("route"))
}
pub(super) async fn erase(State(_): State<AppState>) -> Result<()> {
    Err(ApiError::not_found("route"))
}
pub(super) async fn cancel(State(_): State<AppState>) -> Result<()> {
    Err(ApiError::not_found("route"))
}
pub(super) async fn retry(State(_): State<AppState>) -> Result<()> {
    Err(ApiError::not_found("route"))
}
