//! The memory of another process.

use std::fs;

/// Resident bytes of a process (`man 5 proc`: the second number of `statm`, in pages); none when it
/// has ended, or where there is no `/proc`.
pub(super) fn resident_bytes(pid: u32) -> Option<u64> {
    let statm = fs::read_to_string(format!("/proc/{pid}/statm")).ok()?;
    let pages: u64 = statm.split_whitespace().nth(1)?.parse().ok()?;
    Some(pages * rustix::param::page_size() as u64)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn memory_that_is_written_is_resident() {
        let before = resident_bytes(std::process::id()).unwrap();
        let block = vec![1_u8; 64 << 20];
        let after = resident_bytes(std::process::id()).unwrap();
        // Other tests of the process free and take some too.
        assert!(after > before + (32 << 20), "{before} {after}");
        assert_eq!(block.len(), 64 << 20);
        assert_eq!(resident_bytes(u32::MAX), None);
    }
}
