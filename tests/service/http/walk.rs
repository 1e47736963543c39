//! Operations of the contract as requests.

use axum::body::Body;
use axum::http::Request;

use crate::http::support::sphere_xyz;

/// Ids of a record of each kind, by the first part of its address.
pub(crate) type Ids<'a> = [(&'static str, &'a str); 6];

/// Ids of nothing that is there.
pub(crate) const NOWHERE: Ids<'static> = [
    ("clouds", "cld_00000000000000000000000000000000"),
    ("jobs", "job_00000000000000000000000000000000"),
    ("uploads", "upl_00000000000000000000000000000000"),
    ("batches", "bat_00000000000000000000000000000000"),
    ("webhooks", "whk_00000000000000000000000000000000"),
    ("deliveries", "msg_00000000000000000000000000000000"),
];

/// The path of an operation, with the id of a record in it.
pub(crate) fn filled(path: &str, ids: &Ids<'_>) -> String {
    let kind = path.split('/').nth(2).unwrap_or_default();
    let known = ids.iter().find(|(known, _)| *known == kind);
    let id = known.map_or("00000000", |(_, id)| id);
    path.replace("{id}", id)
        .replace("{format}", "ply")
        .replace("snapshots/{file}", "snapshots/5.ply")
        .replace("{file}", "app.js")
}

pub(crate) fn request(method: &str, path: &str) -> Request<Body> {
    let body = match path {
        "/v1/clouds" if method == "POST" => Body::from(sphere_xyz(100, 7.0)),
        _ if path.ends_with("/field") => Body::from(r#"{"points": [[0, 0, 0]]}"#),
        _ if method == "POST" => Body::from("{}"),
        _ => Body::empty(),
    };
    let mut request = Request::builder().method(method).uri(path);
    if path == "/v1/events" {
        // As a stream it would not end.
        request = request.header("accept", "application/json");
    }
    if method == "POST" && path != "/v1/clouds" {
        request = request.header("content-type", "application/json");
    }
    request.body(body).unwrap()
}
