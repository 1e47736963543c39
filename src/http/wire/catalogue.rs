//! The one table of problems: name, status, whether to try again, meaning.

/// Writes the codes and the table that says what each means.
macro_rules! catalogue {
    ($($code:ident $name:literal $status:literal $retryable:literal $title:literal;)*) => {
        /// Stable name of a problem.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum Code {
            $(#[doc = $title] $code,)*
        }

        /// All problems: what `openapi.yaml` must list.
        pub const CATALOGUE: &[Entry] = &[
            $(Entry { code: Code::$code, name: $name, status: $status, retryable: $retryable, title: $title },)*
        ];
    };
}

/// A row of the [`CATALOGUE`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    /// The code.
    pub code: Code,
    /// Its `snake_case` name in JSON.
    pub name: &'static str,
    /// HTTP status; for a job's own failures the one its `error` carries.
    pub status: u16,
    /// Whether the same request can succeed later.
    pub retryable: bool,
    /// What it means, the same for every occurrence.
    pub title: &'static str,
}

catalogue! {
    MalformedRequest "malformed_request" 400 false "This is no request of HTTP.";
    MalformedJson "malformed_json" 400 false "The body is not JSON.";
    MalformedMultipart "malformed_multipart" 400 false "The body is not a usable multipart form.";
    BadHeader "bad_header" 400 false "A header cannot be understood.";
    BadCursor "bad_cursor" 400 false "The cursor is none of ours.";
    KeyInAddress "key_in_address" 400 false "A key is in the address.";
    UploadLength "upload_length" 400 false "The lengths of the upload contradict each other.";
    BodyBrokenOff "body_broken_off" 400 true "The body broke off.";
    Unauthenticated "unauthenticated" 401 false "The request has no key that is good.";
    Forbidden "forbidden" 403 false "The key does not allow this.";
    CrossOriginRefused "cross_origin_refused" 403 false "A page of another site sent the request.";
    NotFound "not_found" 404 false "There is nothing here.";
    MethodNotAllowed "method_not_allowed" 405 false "This method is not for this resource.";
    NotAcceptable "not_acceptable" 406 false "None of the accepted media types can be given.";
    UploadTimeout "upload_timeout" 408 true "The upload stood still for too long.";
    ResultNotReady "result_not_ready" 409 true "The job has not ended.";
    ModelUnreadable "model_unreadable" 409 false "The network cannot be read by this version.";
    CloudInUse "cloud_in_use" 409 true "A job that has not ended needs the cloud.";
    KeyName "key_name" 409 false "A key of this name is there already.";
    KeyInFile "key_in_file" 409 false "The file of the service decides about this.";
    WebhookLimit "webhook_limit" 409 false "The tenant has as many webhooks as it may have.";
    Held "held" 409 false "It is held and must not be erased.";
    IdempotencyInFlight "idempotency_in_flight" 409 true "The first request with this key is being worked on.";
    UploadOffset "upload_offset" 409 true "The upload is at another place.";
    UploadTaken "upload_taken" 409 true "A newer request goes on with the upload.";
    Gone "gone" 410 false "It was erased.";
    PreconditionFailed "precondition_failed" 412 false "It is not the version that is asked for.";
    BodyTooLarge "body_too_large" 413 false "The body is larger than allowed.";
    TooManyPoints "too_many_points" 413 false "The cloud has more points than allowed.";
    CloudNeedsMemory "cloud_needs_memory" 413 false "Reading the file needs more memory than there is.";
    UnsupportedFormat "unsupported_format" 415 false "The format is not supported.";
    UnsupportedEncoding "unsupported_encoding" 415 false "The encoding is not supported or damaged.";
    RangeNotSatisfiable "range_not_satisfiable" 416 false "The range lies outside of the content.";
    HostNotAllowed "host_not_allowed" 421 false "The service does not answer to this host.";
    RequestInvalid "request_invalid" 422 false "A parameter or a field is refused.";
    IdempotencyMismatch "idempotency_mismatch" 422 false "The key was used for another request.";
    CloudMissing "cloud_missing" 422 false "The cloud that is named does not exist.";
    CloudEmpty "cloud_empty" 422 false "The cloud has no points.";
    CloudTooFewPoints "cloud_too_few_points" 422 false "The cloud has too few points.";
    CloudDegenerate "cloud_degenerate" 422 false "The points span no volume.";
    CloudFilled "cloud_filled" 422 false "The points fill a solid volume; those of its surface are needed.";
    SlicesUnusable "slices_unusable" 422 false "No surface can be made from the slices.";
    CloudNotFinite "cloud_not_finite" 422 false "No point has finite coordinates.";
    CloudTooLarge "cloud_too_large" 422 false "Coordinates are too large.";
    CloudTruncated "cloud_truncated" 422 false "The file ends before what it declares.";
    CloudHeader "cloud_header" 422 false "The header of the file cannot be understood.";
    CloudRow "cloud_row" 422 false "A row of the file cannot be understood.";
    CloudNoCoordinates "cloud_no_coordinates" 422 false "The file has no coordinates.";
    OrientationMissing "orientation_missing" 422 false "The file does not say how it lies in the patient.";
    SourceMissing "source_missing" 422 false "The file holds several parts, and none is chosen.";
    SourceUnknown "source_unknown" 422 false "The part that is chosen is not in the file.";
    NormalsInvalid "normals_invalid" 422 false "The normals cannot be used.";
    SettingsInvalid "settings_invalid" 422 false "Settings are unknown, mistyped or out of bounds.";
    SettingsConflict "settings_conflict" 422 false "Settings contradict each other or the cloud.";
    GridTooLarge "grid_too_large" 422 false "The grid needs more memory than allowed.";
    TrainingTooLarge "training_too_large" 422 false "The training needs more memory than allowed.";
    RateLimited "rate_limited" 429 true "Too many requests.";
    Quota "quota" 429 true "The quota is used up.";
    HeadTooLarge "head_too_large" 431 false "The line and the headers of the request are too large.";
    Internal "internal" 500 true "The service failed.";
    QueueFull "queue_full" 503 true "As many jobs as allowed wait already.";
    Draining "draining" 503 true "The service is about to stop.";
    NotReady "not_ready" 503 true "The service is not ready.";
    DatabaseBusy "database_busy" 503 true "The database is busy.";
    StorageUnavailable "storage_unavailable" 503 true "The object store is away.";
    InsufficientStorage "insufficient_storage" 507 true "The disk is nearly full.";
    TrainingDiverged "training_diverged" 422 false "Training diverged.";
    NoSurface "no_surface" 422 false "The trained field has no surface.";
    MeshTooLarge "mesh_too_large" 422 false "The mesh would be larger than allowed.";
    OutOfMemory "out_of_memory" 500 false "The worker needed more memory than allowed.";
    TimeLimit "time_limit" 422 false "The job took longer than allowed.";
    WorkerCrashed "worker_crashed" 500 true "The worker died in every attempt.";
}

impl Code {
    /// Its row in the table.
    pub fn entry(self) -> Entry {
        // The table is written in the order of the variants.
        CATALOGUE[self as usize]
    }

    /// The code of this name; `Internal` for a name that is not in the table.
    pub fn from_name(name: &str) -> Self {
        let entry = CATALOGUE.iter().find(|entry| entry.name == name);
        entry.map_or(Self::Internal, |entry| entry.code)
    }
}

#[cfg(test)]
mod tests {
    use axum::http::StatusCode;

    use super::*;

    #[test]
    fn the_table_is_in_the_order_of_its_codes() {
        for entry in CATALOGUE {
            assert_eq!(entry.code.entry(), *entry);
            assert_eq!(Code::from_name(entry.name), entry.code);
            assert!(StatusCode::from_u16(entry.status).is_ok());
        }
        assert_eq!(Code::from_name("unheard_of"), Code::Internal);
    }
}
