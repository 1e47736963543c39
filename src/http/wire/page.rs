//! Pages of lists, newest first. A page starts after the last item of the one before; new items
//! come before the first page, so nothing is repeated or left out.

use std::str::FromStr;

use axum::Json;
use axum::http::Uri;
use axum::http::header::LINK;
use axum::response::{IntoResponse, Response};
use serde::Serialize;

use crate::http::api;
use crate::http::wire::error::{ApiError, Code, Result};
use crate::http::wire::extract::{Query, text};

const DEFAULT_LIMIT: u32 = 50;
pub(in crate::http) const MAX_LIMIT: u32 = 200;

/// Which part of a list is asked for.
#[derive(Debug)]
pub(in crate::http) struct Page<T> {
    /// Last item of the page before.
    pub(in crate::http) before: Option<T>,
    /// Most items.
    pub(in crate::http) limit: u32,
}

/// A page and where the next one begins.
#[derive(Debug)]
pub(in crate::http) struct PageOf<T> {
    /// The items.
    pub(in crate::http) items: Vec<T>,
    /// The next page.
    pub(in crate::http) next: Next,
}

/// The beginning of the next page, if there is one.
#[derive(Debug)]
pub(in crate::http) struct Next(Option<String>);

impl<T: FromStr> Page<T> {
    /// Takes `cursor` and `limit` out of a query.
    ///
    /// # Errors
    /// [`Code::BadCursor`]. A limit out of bounds is told by [`Query::finish`].
    pub(in crate::http) fn of(query: &mut Query) -> Result<Self> {
        let limit = query.take("limit", |value| match text::<u32>(value) {
            Ok(limit @ 1..=MAX_LIMIT) => Ok(limit),
            _ => Err(format!("must be a number from 1 to {MAX_LIMIT}")),
        });
        let cursor = query.take("cursor", Ok);
        let before = cursor.map(|cursor| {
            let id = unveil(&cursor).and_then(|id| id.parse().ok());
            id.ok_or_else(|| {
                let detail = "take the cursor from next_cursor of the page before";
                ApiError::new(Code::BadCursor, detail)
            })
        });
        Ok(Self {
            before: before.transpose()?,
            limit: limit.unwrap_or(DEFAULT_LIMIT),
        })
    }

    /// Cuts the items, of which one more than the limit was read, to a page.
    pub(in crate::http) fn cut<I>(
        &self,
        mut found: Vec<I>,
        id: impl Fn(&I) -> String,
    ) -> PageOf<I> {
        let more = found.len() > self.limit as usize;
        found.truncate(self.limit as usize);
        let last = found.last().filter(|_| more);
        PageOf {
            next: Next(last.map(|item| veil(&id(item)))),
            items: found,
        }
    }
}

impl Next {
    /// The answer to a request for a page, which has these items.
    pub(in crate::http) fn answer<T: Serialize>(self, uri: &Uri, items: Vec<T>) -> Response {
        let link = self.link(uri);
        let body = Json(api::Page {
            items,
            next_cursor: self.0,
        });
        match link {
            Some(link) => ([(LINK, link)], body).into_response(),
            None => body.into_response(),
        }
    }

    /// The `Link` header: the same query with the new cursor.
    fn link(&self, uri: &Uri) -> Option<String> {
        let cursor = self.0.as_deref()?;
        let kept = uri.query().unwrap_or_default().split('&');
        let mut pairs: Vec<&str> = kept
            .filter(|pair| !pair.is_empty() && !pair.starts_with("cursor="))
            .collect();
        let cursor = format!("cursor={cursor}");
        pairs.push(&cursor);
        Some(format!(
            "<{}?{}>; rel=\"next\"",
            uri.path(),
            pairs.join("&")
        ))
    }
}

/// Cursors are opaque because their content may change.
fn veil(id: &str) -> String {
    crate::http::wire::download::hex(id.as_bytes())
}

fn unveil(cursor: &str) -> Option<String> {
    let digits = cursor.as_bytes();
    let pairs = digits.chunks(2).map(|pair| {
        let pair = std::str::from_utf8(pair).ok()?;
        u8::from_str_radix(pair, 16).ok()
    });
    String::from_utf8(pairs.collect::<Option<Vec<u8>>>()?).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cursor_survives_and_others_are_refused() {
        assert_eq!(unveil(&veil("job_1")).as_deref(), Some("job_1"));
        assert_eq!(unveil("job_1"), None);
        assert_eq!(unveil("ff"), None);
    }

    #[test]
    fn the_link_keeps_the_filters() {
        let uri: Uri = "/v1/jobs?status=queued&cursor=00&limit=2".parse().unwrap();
        let link = Next(Some("ab".to_owned())).link(&uri).unwrap();
        assert_eq!(
            link,
            "</v1/jobs?status=queued&limit=2&cursor=ab>; rel=\"next\""
        );
    }
}
