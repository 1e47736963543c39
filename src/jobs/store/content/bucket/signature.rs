//! Requests that are signed already, signed for another time: Signature Version 4 of AWS.
//!
//! The client of the object store signs with the clock of this machine and lets nobody say another
//! time. What is signed, and for which place, stays as it said.

use hmac::{Hmac, KeyInit, Mac};
use hyper::header::{AUTHORIZATION, HOST, HeaderValue};
use object_store::aws::AwsCredential;
use object_store::client::HttpRequest;
use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, utf8_percent_encode};
use sha2::{Digest, Sha256};
use time::OffsetDateTime;
use url::{Position, Url};

const ALGORITHM: &str = "AWS4-HMAC-SHA256";

/// What is not as it is in names and values of a query.
const ENCODED: &AsciiSet = &NON_ALPHANUMERIC
    .remove(b'-')
    .remove(b'.')
    .remove(b'_')
    .remove(b'~');

/// Signs a request for this time, in milliseconds since the epoch. None if it was not signed this way
/// before.
pub(super) fn sign(request: &mut HttpRequest, credential: &AwsCredential, at: i64) -> Option<()> {
    let before = text(request, AUTHORIZATION.as_str())?;
    let (scope, rest) = before.split_once(", SignedHeaders=")?;
    let (names, _) = rest.split_once(", Signature=")?;
    let [end, service, region, _] = *scope.rsplitn(4, '/').collect::<Vec<_>>() else {
        return None;
    };
    let hash = text(request, "x-amz-content-sha256")?;
    let url = Url::parse(&request.uri().to_string()).ok()?;

    let time = OffsetDateTime::from_unix_timestamp(at.div_euclid(1_000)).ok()?;
    let day = format!(
        "{:04}{:02}{:02}",
        time.year(),
        u8::from(time.month()),
        time.day()
    );
    let (hour, minute, second) = time.to_hms();
    let date = format!("{day}T{hour:02}{minute:02}{second:02}Z");
    let headers = request.headers_mut();
    headers.insert("x-amz-date", HeaderValue::from_str(&date).ok()?);
    if let Some(token) = &credential.token {
        headers.insert("x-amz-security-token", HeaderValue::from_str(token).ok()?);
    }

    let lines = names.split(';').map(|name| {
        if name == HOST.as_str() {
            let host = &url[Position::BeforeHost..Position::AfterPort];
            return Some(format!("{name}:{host}\n"));
        }
        text(request, name).map(|value| format!("{name}:{value}\n"))
    });
    let lines = lines.collect::<Option<Vec<_>>>()?.concat();
    let method = request.method().as_str();
    let signed = [method, url.path(), &query(&url), &lines, names, &hash].join("\n");

    let scope = format!("{day}/{region}/{service}/{end}");
    let hash = hex::encode(Sha256::digest(signed));
    let mut key = format!("AWS4{}", credential.secret_key).into_bytes();
    for part in [&day, region, service, end] {
        key = mac(&key, part)?;
    }
    let signature = mac(&key, &format!("{ALGORITHM}\n{date}\n{scope}\n{hash}"))?;
    let authorization = format!(
        "{ALGORITHM} Credential={}/{scope}, SignedHeaders={names}, Signature={}",
        credential.key_id,
        hex::encode(signature)
    );
    let authorization = HeaderValue::from_str(&authorization).ok()?;
    request.headers_mut().insert(AUTHORIZATION, authorization);
    Some(())
}

/// The values of a header, without the spaces that do not count.
fn text(request: &HttpRequest, name: &str) -> Option<String> {
    let values = request.headers().get_all(name).iter();
    let values: Option<Vec<String>> = values
        .map(|value| {
            let words = value.to_str().ok()?.split_whitespace();
            Some(words.collect::<Vec<_>>().join(" "))
        })
        .collect();
    values
        .filter(|values| !values.is_empty())
        .map(|values| values.join(","))
}

fn query(url: &Url) -> String {
    let encoded = |text: &str| utf8_percent_encode(text, ENCODED).to_string();
    let pairs = url.query_pairs();
    let mut pairs: Vec<_> = pairs.map(|(k, v)| (encoded(&k), encoded(&v))).collect();
    pairs.sort_unstable();
    let pairs: Vec<String> = pairs.iter().map(|(k, v)| format!("{k}={v}")).collect();
    pairs.join("&")
}

fn mac(key: &[u8], text: &str) -> Option<Vec<u8>> {
    let mut mac = Hmac::<Sha256>::new_from_slice(key).ok()?;
    mac.update(text.as_bytes());
    Some(mac.finalize().into_bytes().to_vec())
}

#[cfg(test)]
pub(super) mod tests {
    use object_store::aws::AwsAuthorizer;
    use object_store::client::HttpRequestBody;
    use time::{PrimitiveDateTime, format_description};

    use super::*;

    /// 2013-05-24T00:00:00Z, the time of the examples.
    const AT: i64 = 1_369_353_600_000;

    fn credential(token: Option<&str>) -> AwsCredential {
        AwsCredential {
            key_id: "AKIAIOSFODNN7EXAMPLE".to_owned(),
            secret_key: "wJalrXUtnFEMI/K7MDENG/bPxRfiCYEXAMPLEKEY".to_owned(),
            token: token.map(str::to_owned),
        }
    }

    fn request(method: &str, path: &str, headers: &[(&str, &str)]) -> HttpRequest {
        let url = format!("https://examplebucket.s3.amazonaws.com{path}");
        let mut request = hyper::Request::builder().method(method).uri(url);
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        request.body(HttpRequestBody::empty()).unwrap()
    }

    /// The time that a request is signed for, in milliseconds since the epoch.
    pub(in crate::jobs::store::content::bucket) fn signed_at(request: &HttpRequest) -> i64 {
        let form = "[year][month][day]T[hour][minute][second]Z";
        let form = format_description::parse_borrowed::<2>(form).unwrap();
        let date = request.headers()["x-amz-date"].to_str().unwrap();
        let date = PrimitiveDateTime::parse(date, &form).unwrap();
        date.assume_utc().unix_timestamp() * 1_000
    }

    fn authorization(request: &HttpRequest) -> &str {
        request.headers()[AUTHORIZATION].to_str().unwrap()
    }

    /// The examples of "Authenticating Requests: Using the Authorization Header" in the reference of S3.
    #[test]
    fn requests_are_signed_as_the_reference_signs_them() {
        const EMPTY: &str = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
        const WELCOME: &str = "44ce7dd67c959e0d3524ffac1771dfbba87d2b6b4b4e99e42034a8b803f8b072";
        for (method, path, headers, hash, expected) in [
            (
                "GET",
                "/test.txt",
                &[("range", "bytes=0-9")][..],
                EMPTY,
                "f0e8bdb87c964420e857bd35b5d6ed310bd44f0170aba48dd91039c6036bdb41",
            ),
            (
                "PUT",
                "/test%24file.text",
                &[
                    ("date", "Fri, 24 May 2013 00:00:00 GMT"),
                    ("x-amz-storage-class", "REDUCED_REDUNDANCY"),
                ],
                WELCOME,
                "98ad721746da40c64f1a55b78f14c238d841ea1380cd77a1b5971af0ece108bd",
            ),
            (
                "GET",
                "/?lifecycle",
                &[],
                EMPTY,
                "fea454ca298b7da1c68078a5d1bdbfbbe0d65c699e0f91ac7a200a0136783543",
            ),
            (
                "GET",
                "/?max-keys=2&prefix=J",
                &[],
                EMPTY,
                "34b48302e7b5fa45bde8084f4b7868a86f0a534bc59db6670ed5711ef69dc6f7",
            ),
        ] {
            let mut request = request(method, path, headers);
            request
                .headers_mut()
                .insert("x-amz-content-sha256", HeaderValue::from_static(hash));
            let mut names = vec!["host", "x-amz-content-sha256", "x-amz-date"];
            names.extend(headers.iter().map(|(name, _)| *name));
            names.sort_unstable();
            let names = names.join(";");
            let before = format!(
                "{ALGORITHM} Credential=before/20010101/us-east-1/s3/aws4_request, \
                 SignedHeaders={names}, Signature=0"
            );
            let before = HeaderValue::from_str(&before).unwrap();
            request.headers_mut().insert(AUTHORIZATION, before);
            sign(&mut request, &credential(None), AT).unwrap();
            let expected = format!(
                "{ALGORITHM} Credential=AKIAIOSFODNN7EXAMPLE/20130524/us-east-1/s3/aws4_request, \
                 SignedHeaders={names}, Signature={expected}"
            );
            assert_eq!(authorization(&request), expected);
        }
    }

    /// Signed for the time that the client took, the signature is that of the client.
    #[test]
    fn a_signature_is_the_one_that_the_client_makes() {
        let credential = credential(Some("a token/+="));
        let mut request = request(
            "PUT",
            "/a%20b/%C3%A9~?partNumber=1&uploadId=a%2Fb+c%7E*&x=%C3%A9&x=a",
            &[("x-amz-checksum-sha256", "a=="), ("content-type", "a   b")],
        );
        *request.body_mut() = vec![1, 2, 3].into();
        let signer = AwsAuthorizer::new(&credential, "s3", "eu-central-2");
        signer.try_authorize(&mut request, None).unwrap();
        let expected = request.clone();
        let at = signed_at(&expected);
        sign(&mut request, &credential, at + 3_600_000).unwrap();
        assert_ne!(authorization(&request), authorization(&expected));
        sign(&mut request, &credential, at).unwrap();
        assert_eq!(request.headers(), expected.headers());
    }

    #[test]
    fn what_is_not_signed_stays_so() {
        let mut request = request("GET", "/", &[]);
        assert_eq!(sign(&mut request, &credential(None), AT), None);
        assert!(request.headers().is_empty());
    }
}
