//! Processes of this machine, as proc(5) tells of them.

use std::fs;
use std::process::Command;

/// Returns the fields of a process's `stat` from the third one on; `None` if it has ended.
fn stat(pid: u32) -> Option<Vec<String>> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The second field may hold spaces.
    let (_, fields) = stat.rsplit_once(')')?;
    Some(fields.split_whitespace().map(str::to_owned).collect())
}

/// Returns the CPU time that a process has used, s.
pub fn cpu_s(pid: u32) -> f64 {
    // Fields 14 and 15, in ticks of 10 ms.
    let fields = stat(pid).unwrap();
    let ticks = |at: usize| fields[at].parse::<f64>().unwrap();
    (ticks(11) + ticks(12)) / 100.0
}

/// Returns each process with its parent.
pub fn parents() -> Vec<(u32, u32)> {
    let entries = fs::read_dir("/proc").unwrap().filter_map(Result::ok);
    let pair = |entry: fs::DirEntry| {
        let pid = entry.file_name().to_str()?.parse().ok()?;
        Some((pid, stat(pid)?[1].parse().ok()?))
    };
    entries.filter_map(pair).collect()
}

/// Sends a signal to processes; one that has ended meanwhile is no failure.
pub fn signal(name: &str, processes: &[u32]) {
    let pids = processes.iter().map(u32::to_string);
    drop(Command::new("kill").args(["-s", name]).args(pids).output());
}
