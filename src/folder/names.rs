//! The names of files that the service makes in its folders. Nothing with another name is removed:
//! whoever put it there may want it back.

use std::fs;
use std::io;
use std::path::Path;

use crate::reconstruction::mesh::write::Format;

/// Digits of a SHA-256 in a name.
const HASH_DIGITS: usize = 64;
/// What temporary files begin with, and how many letters and digits follow: as `tempfile` names
/// them.
const TEMPORARY: (&str, usize) = (".tmp", 6);

/// Whether an upload or an encoding under way has such a name.
pub fn is_temporary(name: &str) -> bool {
    let (prefix, length) = TEMPORARY;
    name.strip_prefix(prefix).is_some_and(|random| {
        random.len() == length && random.bytes().all(|b| b.is_ascii_alphanumeric())
    })
}

/// Whether a cloud has such a name: the SHA-256 of its bytes.
pub fn is_cloud(name: &str) -> bool {
    let digit = |b: u8| matches!(b, b'0'..=b'9' | b'a'..=b'f');
    name.len() == HASH_DIGITS && name.bytes().all(digit)
}

/// Whether an upload that may go on has such a name: its id.
pub fn is_resumable(name: &str) -> bool {
    let digit = |b: u8| matches!(b, b'0'..=b'9' | b'a'..=b'f');
    let digits = name.strip_prefix("upl_");
    digits.is_some_and(|digits| digits.len() == 32 && digits.bytes().all(digit))
}

/// Whether a mesh that was encoded for a download has such a name, or is about to get it.
pub fn is_encoding(name: &str) -> bool {
    let kept = name
        .split_once('.')
        .is_some_and(|(hash, rest)| is_cloud(hash) && is_rendition(rest));
    kept || is_temporary(name)
}

/// What stands for a mask where other encodings have the name of a format.
pub const MASK: &str = "mask";

/// Whether that can stand behind the hash: a format, and after a hyphen what else makes a difference.
fn is_rendition(name: &str) -> bool {
    let (kind, rest) = name.split_once('-').unwrap_or((name, ""));
    let known = kind == MASK || Format::from_name(kind).is_some();
    known
        && rest
            .bytes()
            .all(|b| b.is_ascii_alphanumeric() || b"_-".contains(&b))
}

/// Removes the files of a folder, not of those below it, that are to go.
///
/// # Errors
/// When the folder cannot be read or a file cannot be removed.
pub fn remove_files(
    folder: &Path,
    mut goes: impl FnMut(&str, &fs::DirEntry) -> bool,
) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name();
        let is_file = entry.file_type()?.is_file();
        if !is_file || !name.to_str().is_some_and(|name| goes(name, &entry)) {
            continue;
        }
        match fs::remove_file(entry.path()) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_that_are_made_here_are_ours() {
        let hash = "0123456789abcdef".repeat(4);
        assert!(is_cloud(&hash) && is_temporary(".tmpAb3xY9"));
        assert!(is_resumable(&format!("upl_{}", &hash[32..])));
        assert!(is_encoding(&format!("{hash}.ply")) && is_encoding(".tmpAb3xY9"));
        for other in [
            "scan.ply",
            ".tmp",
            ".tmpfile",
            ".tmp12345",
            ".tmp1234567",
            ".tmp12-456",
            &hash[1..],
            &hash.to_uppercase(),
            &format!("{hash}0"),
            &format!("{hash}.zip"),
            &format!("{hash}.ply.bak"),
            &format!("{hash}.mask.ply"),
            &format!("{hash}.zip-ply"),
            &format!("{hash}.ply-../x"),
            &format!("{hash}."),
        ] {
            assert!(
                !is_cloud(other) && !is_temporary(other) && !is_encoding(other),
                "{other}"
            );
            assert!(!is_resumable(other), "{other}");
        }
        assert!(!is_cloud(&format!("{hash}.ply")) && !is_encoding(&hash));
    }

    #[test]
    fn a_temporary_file_has_a_name_of_ours() {
        let folder = tempfile::tempdir().unwrap();
        let file = tempfile::NamedTempFile::new_in(&folder).unwrap();
        let name = file.path().file_name().unwrap().to_str().unwrap();
        assert!(is_temporary(name), "{name}");
    }
}
