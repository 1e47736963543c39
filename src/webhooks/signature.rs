//! What messages are signed with, and how.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use hmac::{Hmac, KeyInit, Mac};
use sha2::Sha256;

/// What stands before a secret that is shown.
const PREFIX: &str = "whsec_";

/// Bytes of a new secret; the standard asks for 24 to 64.
const BYTES: usize = 32;

/// What the messages to a webhook are signed with.
#[derive(Clone, PartialEq, Eq)]
pub struct Secret(Vec<u8>);

impl Secret {
    /// A new one.
    ///
    /// # Errors
    /// When the system gives no random numbers.
    pub fn generate() -> Result<Self, getrandom::Error> {
        let mut bytes = vec![0; BYTES];
        getrandom::fill(&mut bytes)?;
        Ok(Self(bytes))
    }

    /// As receivers are told it.
    pub fn reveal(&self) -> String {
        format!("{PREFIX}{}", STANDARD.encode(&self.0))
    }

    /// As it is kept.
    pub fn into_bytes(self) -> Vec<u8> {
        self.0
    }
}

/// The header `webhook-signature` of a message: a signature with each of the secrets.
pub(super) fn signatures(
    secrets: &[Vec<u8>],
    (id, seconds): (&str, i64),
    body: &[u8],
) -> Result<String, hmac::digest::InvalidLength> {
    let sign = |secret: &Vec<u8>| {
        let mut mac = Hmac::<Sha256>::new_from_slice(secret)?;
        mac.update(format!("{id}.{seconds}.").as_bytes());
        mac.update(body);
        Ok(format!(
            "v1,{}",
            STANDARD.encode(mac.finalize().into_bytes())
        ))
    };
    let signed: Result<Vec<_>, _> = secrets.iter().map(sign).collect();
    Ok(signed?.join(" "))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The example of the reference implementations of Standard Webhooks.
    #[test]
    fn a_message_is_signed_as_others_sign_it() {
        let secret = STANDARD.decode("MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw").unwrap();
        let message = ("msg_p5jXN8AQM9LWM0D4loKWxJek", 1_614_265_330);
        let body = br#"{"test": 2432232314}"#;
        let expected = "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE=";
        let signed = signatures(std::slice::from_ref(&secret), message, body).unwrap();
        assert_eq!(signed, expected);
        let both = signatures(&[b"new".to_vec(), secret], message, body).unwrap();
        assert!(both.ends_with(&format!(" {expected}")), "{both}");
    }

    #[test]
    fn a_secret_is_shown_with_its_prefix() {
        let shown = Secret::generate().unwrap().reveal();
        let bytes = STANDARD
            .decode(shown.strip_prefix("whsec_").unwrap())
            .unwrap();
        assert_eq!(bytes.len(), 32);
    }
}
