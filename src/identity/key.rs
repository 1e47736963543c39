//! The text of a key and its hash.
//!
//! `mw_`, 22 random digits of base 62 (131 bits) and 6 digits with the CRC-32 of what precedes. The
//! prefix and the checksum let scanners find a key that leaked, and let a mistyped one be refused
//! without a look at the others. The service keeps the SHA-256 of the whole text. A slow hash, as for
//! passwords, would protect nothing more: nobody can try 2¹³¹ keys.

use std::fmt;
use std::str::FromStr;

use flate2::Crc;
use sha2::{Digest, Sha256};

/// What every key begins with.
const PREFIX: &str = "mw_";

/// Random digits after the prefix.
const RANDOM: usize = 22;

/// Digits of the checksum: 62⁶ is more than 2³².
const CHECK: usize = 6;

const DIGITS: &[u8; 62] = b"0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz";

/// The text of a key. It is shown by [`Secret::reveal`] alone.
#[derive(Clone, PartialEq, Eq)]
pub struct Secret(String);

impl Secret {
    /// A new key.
    ///
    /// # Errors
    /// When the system has no random numbers.
    pub fn generate() -> Result<Self, getrandom::Error> {
        let mut text = PREFIX.to_owned();
        while text.len() < PREFIX.len() + RANDOM {
            let mut bytes = [0; RANDOM];
            getrandom::fill(&mut bytes)?;
            // 248 is the largest multiple of 62 in a byte: beyond it some digits would come more often.
            let even = bytes.iter().filter(|byte| **byte < 248);
            let left = PREFIX.len() + RANDOM - text.len();
            text.extend(even.take(left).map(|byte| digit(u32::from(*byte))));
        }
        let check = checksum(&text);
        Ok(Self(text + &check))
    }

    /// The key itself.
    pub fn reveal(&self) -> &str {
        &self.0
    }

    /// What is kept of it.
    pub fn hash(&self) -> KeyHash {
        KeyHash(Sha256::digest(&self.0).into())
    }
}

impl FromStr for Secret {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let body = text.strip_prefix(PREFIX).unwrap_or_default();
        if body.len() != RANDOM + CHECK || !body.bytes().all(|b| DIGITS.contains(&b)) {
            return Err("is no key: one has the form mw_ and 28 letters and digits");
        }
        let (random, check) = text.split_at(PREFIX.len() + RANDOM);
        if checksum(random) == check {
            Ok(Self(text.to_owned()))
        } else {
            Err("is no key: its checksum is wrong, so a character is missing or mistyped")
        }
    }
}

impl fmt::Debug for Secret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Secret({})", self.hash().id())
    }
}

fn digit(number: u32) -> char {
    char::from(DIGITS[(number % 62) as usize])
}

fn checksum(text: &str) -> String {
    let mut crc = Crc::new();
    crc.update(text.as_bytes());
    let mut rest = crc.sum();
    let digits = (0..CHECK).map(|_| {
        let next = digit(rest);
        rest /= 62;
        next
    });
    digits.collect()
}

/// The SHA-256 of a key.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct KeyHash([u8; 32]);

impl KeyHash {
    /// What the key goes by in lists and in the audit trail: the first 8 digits of its hash.
    pub fn id(&self) -> String {
        hex::encode(&self.0[..4])
    }
}

impl FromStr for KeyHash {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let mut hash = [0; 32];
        text.strip_prefix("sha256:")
            .and_then(|digits| hex::decode_to_slice(digits, &mut hash).ok())
            .ok_or("a hash has the form sha256: and 64 hexadecimal digits")?;
        Ok(Self(hash))
    }
}

impl fmt::Display for KeyHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "sha256:{}", hex::encode(self.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_survives_its_text_and_another_one_is_another() {
        let key = Secret::generate().unwrap();
        assert_eq!(key.reveal().len(), 31);
        assert_eq!(key.reveal().parse(), Ok(key.clone()));
        assert_ne!(key, Secret::generate().unwrap());
        assert_eq!(key.hash().to_string().parse(), Ok(key.hash()));
        assert!(!format!("{key:?}").contains(&key.reveal()[3..]));
    }

    #[test]
    fn one_wrong_character_is_found() {
        let key = Secret::generate().unwrap();
        for at in 0..key.reveal().len() {
            let mut wrong = key.reveal().to_owned().into_bytes();
            wrong[at] = if wrong[at] == b'x' { b'y' } else { b'x' };
            let wrong = String::from_utf8(wrong).unwrap();
            assert!(wrong.parse::<Secret>().is_err(), "{at}");
        }
        for wrong in ["", "mw_", "mw_ä", "Bearer", &key.reveal()[..30]] {
            assert!(wrong.parse::<Secret>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn the_form_does_not_change() {
        // Its checksum was computed with another program (zlib.crc32 of Python).
        let known = "mw_0123456789ABCDEFGHIJKL";
        assert_eq!(checksum(known), "rfEXO4");
    }
}
