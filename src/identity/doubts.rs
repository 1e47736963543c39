//! What in a file of keys is allowed and hardly meant.

use super::Keyring;

impl Keyring {
    /// What an operator will hardly have meant, each in one sentence: keys that have expired by `now`, in
    /// milliseconds since the epoch, and keys and users of a tenant that the file does not have among those it
    /// lists, which so has none of their limits.
    pub fn doubts(&self, now: i64) -> Vec<String> {
        let ring = self.ring();
        let keys = self.all();
        let expired = keys
            .iter()
            .filter(|key| key.expires.is_some_and(|end| end <= now));
        let expired = expired.map(|key| format!("the key {} has expired", key.name));
        let keys = keys.iter().map(|key| ("key", &key.name, &key.tenant));
        let users = ring
            .users
            .values()
            .map(|user| ("user", &user.name, &user.tenant));
        let mut strays: Vec<_> = keys
            .chain(users)
            .filter(|(_, _, tenant)| !ring.tenants.is_empty() && !ring.tenants.contains_key(tenant))
            .map(|(what, name, tenant)| {
                format!(
                    "the {what} {name} is of the tenant {tenant}, which is not among [[tenants]]"
                )
            })
            .collect();
        strays.sort();
        expired.chain(strays).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identity::Secret;

    #[test]
    fn what_is_hardly_meant_is_told() {
        let hash = Secret::generate().unwrap().hash();
        let key = "tenant = \"radiolgy\"\nexpires = 2027-12-31\nscopes = [\"read\"]";
        let doubts = |text: &str, now| Keyring::of_file(text).unwrap().doubts(now);
        let stray = format!("[[keys]]\nname = \"pacs\"\nhash = \"{hash}\"\n{key}\n");
        assert_eq!(doubts(&stray, 0), [""; 0]);
        let listed = format!("{stray}\n[[tenants]]\nname = \"radiology\"\n");
        assert_eq!(
            doubts(&listed, 1_830_297_600_000),
            [
                "the key pacs has expired",
                "the key pacs is of the tenant radiolgy, which is not among [[tenants]]"
            ]
        );
    }
}
