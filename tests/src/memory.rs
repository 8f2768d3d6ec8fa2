//! The memory of a process, as proc(5) tells of it.

use std::fs;

/// Present and largest memory of a process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Memory {
    /// Present memory, bytes.
    pub held_bytes: u64,
    /// Largest memory since its start, bytes.
    pub most_bytes: u64,
}

/// Returns the memory of a process.
///
/// # Panics
/// When the system does not provide it.
pub fn of(pid: u32) -> Memory {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).expect("proc");
    let bytes = |name: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(name));
        let kib = line.and_then(|line| line.split_whitespace().next());
        let kib: u64 = kib.expect(name).parse().expect("a number");
        kib * 1024
    };
    Memory {
        held_bytes: bytes("VmRSS:"),
        most_bytes: bytes("VmHWM:"),
    }
}
