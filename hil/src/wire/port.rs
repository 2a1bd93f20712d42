//! The serial ports of this machine: which there are, who may open them, who holds them, what udev calls
//! them.
//!
//! All of it is read from `/sys`, `/proc` and `/dev`; what cannot be read is left out, never an error.

use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Where udev keeps the names that stay the same whatever number a device gets.
pub const BY_ID: &str = "/dev/serial/by-id";

/// A program that has a device open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Holder {
    /// Process.
    pub pid: u32,
    /// Its name as the system keeps it, at most 15 letters.
    pub name: String,
}

/// A serial port that is present.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Port {
    /// Device file, `/dev/ttyACM0`.
    pub path: PathBuf,
    /// Its name under `/dev/serial/by-id`.
    pub by_id: Option<PathBuf>,
    /// Group of the device file.
    pub group: Option<String>,
    /// Whether this user may read and write it.
    pub may_open: bool,
}

impl std::fmt::Display for Holder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} (process {})", self.name, self.pid)
    }
}

/// Serial ports with hardware behind them.
pub fn present() -> Vec<Port> {
    let mut ports: Vec<Port> = entries(Path::new("/sys/class/tty"))
        .filter(|tty| tty.join("device").exists())
        // A driver offers places for UARTs; a type of 0 is one without a chip.
        .filter(|tty| word(&tty.join("type")).as_deref() != Some("0"))
        .filter_map(|tty| Some(Path::new("/dev").join(tty.file_name()?)))
        .filter_map(|path| {
            let file = std::fs::metadata(&path).ok()?;
            Some(Port {
                by_id: by_id(&path, Path::new(BY_ID)),
                group: group_name(file.gid()),
                may_open: may_open(&path),
                path,
            })
        })
        .collect();
    ports.sort_by(|a, b| a.path.cmp(&b.path));
    ports
}

/// Who else has the device open, as far as this user may see.
pub fn other_holders(path: &Path) -> Vec<Holder> {
    let own = std::process::id();
    holders(path).into_iter().filter(|holder| holder.pid != own).collect()
}

/// Who has the device open, as far as this user may see.
pub fn holders(path: &Path) -> Vec<Holder> {
    let Ok(device) = std::fs::canonicalize(path) else { return Vec::new() };
    let holds = |process: &Path| {
        entries(&process.join("fd")).any(|fd| std::fs::read_link(fd).is_ok_and(|open| open == device))
    };
    processes().filter(|(_, process)| holds(process)).map(|(pid, process)| holder(pid, &process)).collect()
}

/// The first process of that name.
pub fn process_named(name: &str) -> Option<Holder> {
    processes().map(|(pid, process)| holder(pid, &process)).find(|process| process.name == name)
}

/// The name in `folder`, usually [`BY_ID`], that leads to the same device.
pub fn by_id(path: &Path, folder: &Path) -> Option<PathBuf> {
    let device = std::fs::canonicalize(path).ok()?;
    if path.starts_with(folder) {
        return Some(path.to_owned());
    }
    entries(folder).find(|link| std::fs::canonicalize(link).is_ok_and(|leads_to| leads_to == device))
}

/// Group of the device file.
pub fn group_of(path: &Path) -> Option<String> {
    std::fs::metadata(path).ok().and_then(|file| group_name(file.gid()))
}

/// Whether this user belongs to the group; `None` when there is no such group.
pub fn belongs_to(group: &str) -> Option<bool> {
    let (_, id) = groups().into_iter().find(|(name, _)| name == group)?;
    let own = rustix::process::getgroups().unwrap_or_default();
    Some(rustix::process::getegid().as_raw() == id || own.iter().any(|group| group.as_raw() == id))
}

/// The text of a small file of `/sys` or `/proc`, without the space around it.
pub(crate) fn word(path: &Path) -> Option<String> {
    std::fs::read_to_string(path).ok().map(|text| text.trim().to_owned())
}

fn may_open(path: &Path) -> bool {
    use rustix::fs::Access;
    rustix::fs::access(path, Access::READ_OK | Access::WRITE_OK).is_ok()
}

fn processes() -> impl Iterator<Item = (u32, PathBuf)> {
    entries(Path::new("/proc")).filter_map(|path| Some((path.file_name()?.to_str()?.parse().ok()?, path)))
}

fn holder(pid: u32, process: &Path) -> Holder {
    Holder { pid, name: word(&process.join("comm")).unwrap_or_else(|| "unknown".to_owned()) }
}

fn entries(folder: &Path) -> impl Iterator<Item = PathBuf> {
    std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path())
}

fn groups() -> Vec<(String, u32)> {
    let text = std::fs::read_to_string("/etc/group").unwrap_or_default();
    let group = |line: &str| {
        let mut fields = line.split(':');
        Some((fields.next()?.to_owned(), fields.nth(1)?.parse().ok()?))
    };
    text.lines().filter_map(group).collect()
}

fn group_name(id: u32) -> Option<String> {
    groups().into_iter().find(|(_, group)| *group == id).map(|(name, _)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_is_found_under_its_lasting_name() {
        let folder = std::env::temp_dir().join(format!("hopbench-by-id-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let link = folder.join("usb-Board_1234-if00");
        let _ = std::fs::remove_file(&link);
        std::os::unix::fs::symlink("/dev/null", &link).unwrap();
        assert_eq!(by_id(Path::new("/dev/null"), &folder), Some(link.clone()));
        assert_eq!(by_id(&link, &folder), Some(link));
        assert_eq!(by_id(Path::new("/dev/zero"), &folder), None);
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn whoever_holds_a_file_is_named() {
        let path = std::env::temp_dir().join(format!("hopbench-held-{}", std::process::id()));
        let file = std::fs::File::create(&path).unwrap();
        let pids: Vec<u32> = holders(&path).iter().map(|holder| holder.pid).collect();
        assert_eq!(pids, [std::process::id()]);
        assert_eq!(other_holders(&path), []);
        drop(file);
        assert_eq!(holders(&path), []);
        std::fs::remove_file(&path).unwrap();
    }
}
