//! Which representation a client likes best (`Accept`, RFC 9110 section 12.5.1).

use axum::http::HeaderMap;
use axum::http::header::ACCEPT;

/// The offer with the highest quality; among equals the one that the client names first, then the
/// one that we name first. Without an `Accept` the first offer; `None` where none is accepted.
pub(in crate::http) fn preferred<T: Copy>(headers: &HeaderMap, offers: &[(&str, T)]) -> Option<T> {
    let ranges = ranges(headers);
    if ranges.is_empty() {
        return offers.first().map(|(_, offer)| *offer);
    }
    let rank = |media_type: &str| {
        // The most specific range decides on the quality, whatever comes before it.
        let fits = |(place, range): (usize, &(String, f64))| {
            let specific = specificity(&range.0, media_type)?;
            Some((specific, range.1, place))
        };
        let best = ranges.iter().enumerate().filter_map(fits);
        let (_, quality, place) =
            best.max_by_key(|(specific, _, place)| (*specific, std::cmp::Reverse(*place)))?;
        (quality > 0.0).then_some((quality, place))
    };
    let mut best: Option<((f64, usize), T)> = None;
    for (media_type, offer) in offers {
        let Some((quality, place)) = rank(media_type) else {
            continue;
        };
        let better = best.is_none_or(|((q, p), _)| quality > q || (quality >= q && place < p));
        if better {
            best = Some(((quality, place), *offer));
        }
    }
    best.map(|(_, offer)| offer)
}

/// Media ranges in lower case with their qualities, in the client's order.
fn ranges(headers: &HeaderMap) -> Vec<(String, f64)> {
    let values = headers.get_all(ACCEPT).iter();
    values
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .filter_map(|range| {
            let mut parts = range.split(';').map(str::trim);
            let name = parts.next()?.to_ascii_lowercase();
            let quality = parts.find_map(|part| part.strip_prefix("q="));
            let quality = quality.map_or(1.0, |q| q.parse().unwrap_or(0.0));
            (!name.is_empty()).then_some((name, quality))
        })
        .collect()
}

/// How closely a range names a media type; `None` where it does not.
fn specificity(range: &str, media_type: &str) -> Option<u8> {
    if range == media_type {
        return Some(2);
    }
    if range == "*/*" {
        return Some(0);
    }
    let kind = range.strip_suffix("/*")?;
    (media_type.split('/').next() == Some(kind)).then_some(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    const OFFERS: [(&str, char); 3] = [
        ("application/x-ply", 'p'),
        ("model/obj", 'o'),
        ("model/stl", 's'),
    ];

    #[test]
    fn the_best_offer_wins() {
        for (accept, expected) in [
            ("*/*", Some('p')),
            ("model/stl", Some('s')),
            ("model/*", Some('o')),
            ("text/html, model/stl;q=0.5, model/obj;q=0.4", Some('s')),
            ("model/stl, model/obj", Some('s')),
            ("*/*;q=0.1, model/obj", Some('o')),
            ("application/x-ply;q=0, */*", Some('o')),
            ("text/html", None),
            ("model/obj;q=0", None),
            ("MODEL/OBJ", Some('o')),
        ] {
            let mut headers = HeaderMap::new();
            headers.insert(ACCEPT, accept.parse().unwrap());
            assert_eq!(preferred(&headers, &OFFERS), expected, "{accept}");
        }
        assert_eq!(preferred(&HeaderMap::new(), &OFFERS), Some('p'));
    }
}
