//! What the system tells of a process (`man 5 proc`); nothing where there is no `/proc`.

use std::fs;

use rustix::param::{clock_ticks_per_second, page_size};
use rustix::process::{Resource, getrlimit};

/// What this process uses, and since when.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Usage {
    /// Time of all its threads on a processor.
    pub(crate) cpu_seconds: f64,
    /// Memory that it holds.
    pub(crate) resident_bytes: u64,
    /// Addresses that it has.
    pub(crate) virtual_bytes: u64,
    /// Files and connections that are open.
    pub(crate) open_files: u64,
    /// Most of them; none without a limit.
    pub(crate) most_files: Option<u64>,
    /// When it began, in seconds since the epoch.
    pub(crate) started_seconds: f64,
}

/// What this process uses.
pub(crate) fn usage() -> Option<Usage> {
    let stat = fs::read_to_string("/proc/self/stat").ok()?;
    // The name of the program, in parentheses, may have spaces; the third field comes after it.
    let (_, fields) = stat.rsplit_once(") ")?;
    let fields: Vec<&str> = fields.split_whitespace().collect();
    let seconds = |number: usize| {
        let ticks: u64 = fields.get(number - 3)?.parse().ok()?;
        Some(ticks as f64 / clock_ticks_per_second() as f64)
    };
    let [virtual_bytes, resident_bytes] = memory("self")?;
    Some(Usage {
        cpu_seconds: seconds(14)? + seconds(15)?,
        resident_bytes,
        virtual_bytes,
        open_files: fs::read_dir("/proc/self/fd").ok()?.count() as u64,
        most_files: getrlimit(Resource::Nofile).current,
        started_seconds: booted_seconds()? + seconds(22)?,
    })
}

/// Resident bytes of a process; none when it has ended.
pub(crate) fn resident_bytes(pid: u32) -> Option<u64> {
    memory(&pid.to_string()).map(|[_, resident]| resident)
}

/// Virtual and resident bytes: the first two numbers of `statm`, in pages.
fn memory(process: &str) -> Option<[u64; 2]> {
    let statm = fs::read_to_string(format!("/proc/{process}/statm")).ok()?;
    let mut pages = statm.split_whitespace().map(str::parse::<u64>);
    let mut next = || Some(pages.next()?.ok()? * page_size() as u64);
    Some([next()?, next()?])
}

/// When the system began, in seconds since the epoch.
fn booted_seconds() -> Option<f64> {
    let stat = fs::read_to_string("/proc/stat").ok()?;
    let mut lines = stat.lines();
    lines.find_map(|line| line.strip_prefix("btime ")?.parse().ok())
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use std::io::Read;
    use std::process::{Command, Stdio};
    use std::time::{SystemTime, UNIX_EPOCH};

    use super::*;

    /// Another process holds a block of known size: what this one holds changes with its other tests.
    #[test]
    fn memory_that_is_written_is_resident() {
        const BLOCK: u64 = 64 << 20;
        let mut holder = Command::new("dd")
            .args(["if=/dev/zero", &format!("bs={BLOCK}"), "count=1"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        // The block is full once its first byte is here, and stays while the rest is not read.
        let mut output = holder.stdout.take().unwrap();
        output.read_exact(&mut [0]).unwrap();
        let held = resident_bytes(holder.id()).unwrap();
        holder.kill().unwrap();
        holder.wait().unwrap();
        assert!((BLOCK..2 * BLOCK).contains(&held), "{held}");
        assert_eq!(resident_bytes(u32::MAX), None);
    }

    #[test]
    fn a_process_knows_what_it_uses() {
        let before = usage().unwrap();
        let files: Vec<_> = (0..8)
            .map(|_| fs::File::open("/proc/self/stat").unwrap())
            .collect();
        while usage().unwrap().cpu_seconds < before.cpu_seconds + 0.05 {}
        let after = usage().unwrap();
        assert!(after.open_files >= files.len() as u64);
        assert!(after.virtual_bytes > after.resident_bytes && after.resident_bytes > 1 << 20);
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
        let age = now.as_secs_f64() - after.started_seconds;
        // A test process lives for minutes; both clocks count whole seconds here and there.
        assert!((-2.0..3_600.0).contains(&age), "{age}");
    }
}
