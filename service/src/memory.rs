//! Memory that the process may use: the machine's, or less by the limit of a control group.

use std::fs;
use std::path::{Path, PathBuf};

/// Returns the memory that the process may use, bytes; `None` where the system does not say, as
/// only Linux does.
pub fn allowed_bytes() -> Option<u64> {
    let read = |path: &Path| fs::read_to_string(path).ok();
    let groups = read(Path::new("/proc/self/cgroup")).unwrap_or_default();
    let limits = limits_of(&groups).into_iter();
    let limits = limits.filter_map(|path| read(&path)?.trim().parse().ok());
    let machine = read(Path::new("/proc/meminfo")).and_then(|text| machine_bytes(&text));
    limits.chain(machine).min()
}

/// Returns the memory of the process that is resident, bytes; `None` where the system does not say,
/// as only Linux does.
pub fn resident_bytes() -> Option<u64> {
    let pages = fs::read_to_string("/proc/self/statm").ok()?;
    let resident: u64 = pages.split(' ').nth(1)?.parse().ok()?;
    Some(resident * rustix::param::page_size() as u64)
}

/// Returns the files that have the limits of these control groups, in the form of
/// `/proc/self/cgroup`, and of those that contain them. A group without a limit says `max`, and one
/// that another namespace has is not found.
fn limits_of(groups: &str) -> Vec<PathBuf> {
    let groups = groups.lines();
    let groups = groups.filter_map(|line| line.split_once(':')?.1.split_once(':'));
    let limited = groups.filter_map(|(controllers, group)| {
        if controllers.is_empty() {
            Some(("/sys/fs/cgroup", group, "memory.max"))
        } else if controllers.split(',').any(|one| one == "memory") {
            Some(("/sys/fs/cgroup/memory", group, "memory.limit_in_bytes"))
        } else {
            None
        }
    });
    let files = limited.flat_map(|(root, group, file)| {
        let containing = Path::new(group).ancestors();
        containing.map(move |one| {
            let below = one.strip_prefix("/").unwrap_or(one);
            Path::new(root).join(below).join(file)
        })
    });
    files.collect()
}

/// Returns the memory of the machine, bytes, from the text of `/proc/meminfo`.
fn machine_bytes(text: &str) -> Option<u64> {
    let total = text
        .lines()
        .find_map(|line| line.strip_prefix("MemTotal:"))?;
    let kib: u64 = total.trim().strip_suffix(" kB")?.parse().ok()?;
    Some(kib * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_those_of_a_group_and_of_what_contains_it() {
        let files = |groups| -> Vec<String> {
            let files = limits_of(groups).into_iter();
            files.map(|file| file.display().to_string()).collect()
        };
        let of_systemd = [
            "/sys/fs/cgroup/system.slice/fleetcal.service/memory.max",
            "/sys/fs/cgroup/system.slice/memory.max",
            "/sys/fs/cgroup/memory.max",
        ];
        assert_eq!(files("0::/system.slice/fleetcal.service\n"), of_systemd);
        assert_eq!(files("0::/\n"), ["/sys/fs/cgroup/memory.max"]);
        let of_first = [
            "/sys/fs/cgroup/memory/docker/memory.limit_in_bytes",
            "/sys/fs/cgroup/memory/memory.limit_in_bytes",
        ];
        assert_eq!(files("5:devices:/\n4:hugetlb,memory:/docker\n"), of_first);
        assert_eq!(files("nothing"), [""; 0]);
    }

    #[test]
    fn the_machine_has_memory() {
        let text = "MemTotal:       24683496 kB\nMemFree:        14057124 kB\n";
        assert_eq!(machine_bytes(text), Some(24_683_496 * 1024));
        assert_eq!(machine_bytes("MemFree: 1 kB\n"), None);
        assert!(allowed_bytes().unwrap() > 1 << 20);
        assert!(resident_bytes().unwrap() < allowed_bytes().unwrap());
    }
}
