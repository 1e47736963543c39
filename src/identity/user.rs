//! People, who sign in with a name and a password.

use std::fmt;
use std::str::FromStr;
use std::sync::{Arc, LazyLock};

use argon2::password_hash::phc::PasswordHash;
use argon2::password_hash::{PasswordHasher, PasswordVerifier};
use argon2::{Algorithm, Argon2, Params};

use super::{Limits, Scopes, Tenant};

/// Least characters of a password, as NIST SP 800-63B asks for.
pub const LEAST_PASSWORD: usize = 8;

/// Most bytes of a password: a longer one is no better, and has to be hashed.
pub const MOST_PASSWORD: usize = 1_024;

/// Most memory in KiB, passes and lanes of a hash that is taken from the file: who signs in must not take
/// the memory of the jobs.
const MOST_MEMORY_KIB: u32 = 256 * 1_024;
const MOST_PASSES: u32 = 16;
const MOST_LANES: u32 = 16;

/// A person as it is configured.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct User {
    /// The name, one for each person.
    pub name: Arc<str>,
    /// Whose records are shown.
    pub tenant: Tenant,
    /// What is known of the password.
    pub password: Password,
    /// What is allowed.
    pub scopes: Scopes,
    /// What may be taken.
    pub limits: Limits,
}

/// The hash of a password by Argon2id, as a PHC string. It is not shown by `Debug`.
#[derive(Clone, PartialEq, Eq)]
pub struct Password(String);

impl Password {
    /// The hash of a new password: 19 MiB, two passes, one lane, as OWASP advises.
    ///
    /// # Errors
    /// What is wrong with the password.
    pub fn of(text: &str) -> Result<Self, String> {
        if text.chars().count() < LEAST_PASSWORD || text.len() > MOST_PASSWORD {
            return Err(format!(
                "a password has at least {LEAST_PASSWORD} characters and at most {MOST_PASSWORD} bytes"
            ));
        }
        let hash: PasswordHash = Argon2::default()
            .hash_password(text.as_bytes())
            .map_err(|error| format!("the password was not hashed: {error}"))?;
        Ok(Self(hash.to_string()))
    }

    /// Whether this is the password. Takes some tens of milliseconds of a core, on purpose.
    pub fn is(&self, text: &str) -> bool {
        let known = PasswordHash::new(&self.0);
        text.len() <= MOST_PASSWORD
            && known.is_ok_and(|hash| {
                let verified = Argon2::default().verify_password(text.as_bytes(), &hash);
                verified.is_ok()
            })
    }

    /// A hash of no password: the work for a name that nobody has is the same as for others.
    pub fn nobodys() -> &'static Self {
        static NOBODYS: LazyLock<Password> = LazyLock::new(|| {
            // Whoever knew these bytes would still be nobody.
            let mut noise = [0; 32];
            let _ = getrandom::fill(&mut noise);
            Password::of(&hex::encode(noise)).unwrap_or_else(|_| Password(String::new()))
        });
        &NOBODYS
    }
}

impl FromStr for Password {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = |what: &str| {
            format!("password {what}; `meshway user passwd NAME` makes one: $argon2id$v=19$…")
        };
        let hash = PasswordHash::new(text).map_err(|_| wrong("is no hash"))?;
        if hash.algorithm != Algorithm::Argon2id.ident()
            || hash.hash.is_none()
            || hash.salt.is_none()
        {
            return Err(wrong("is no hash by Argon2id"));
        }
        let params =
            Params::try_from(&hash).map_err(|_| wrong("has parameters that are unknown"))?;
        if params.m_cost() > MOST_MEMORY_KIB
            || params.t_cost() > MOST_PASSES
            || params.p_cost() > MOST_LANES
        {
            return Err(wrong("takes too long to check"));
        }
        Ok(Self(text.to_owned()))
    }
}

impl fmt::Display for Password {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl fmt::Debug for Password {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Password(…)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_password_is_known_by_its_hash_and_by_nothing_else() {
        let password = Password::of("correct horse").unwrap();
        let read: Password = password.to_string().parse().unwrap();
        assert!(read.is("correct horse") && !read.is("correct hors") && !read.is(""));
        assert!(
            password
                .to_string()
                .starts_with("$argon2id$v=19$m=19456,t=2,p=1$")
        );
        assert!(!format!("{password:?}").contains("argon2"));
        assert_ne!(password, Password::of("correct horse").unwrap());
        assert!(Password::of("short").is_err() && Password::of(&"x".repeat(1_025)).is_err());
        assert!(!Password::nobodys().is(""));
    }

    #[test]
    fn hashes_of_other_kinds_and_of_too_much_work_are_refused() {
        let good = Password::of("correct horse").unwrap().to_string();
        for wrong in [
            "secret".to_owned(),
            good.replace("argon2id", "argon2i"),
            good.replace("m=19456", "m=4194304"),
            good.replace("t=2", "t=1000"),
            good[..good.rfind('$').unwrap()].to_owned(),
        ] {
            assert!(
                wrong
                    .parse::<Password>()
                    .unwrap_err()
                    .contains("meshway user passwd")
            );
        }
    }
}
