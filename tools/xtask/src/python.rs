//! The Python environment of the tests: `.venv` at the root, made from a lock file with hashes, made anew
//! when the lock or the interpreter changes.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::{Failure, stage};

const LOCK: &str = "tests/python/requirements.lock";
/// Oldest Python that the lock file serves.
const OLDEST: (u32, u32) = (3, 10);

/// The interpreter of an environment that holds what the lock file names.
pub(crate) fn environment(root: &Path) -> Result<PathBuf, Failure> {
    let system = system_python()?;
    let lock =
        fs::read_to_string(root.join(LOCK)).map_err(|error| Failure::new(format!("{LOCK}: {error}")))?;
    let venv = root.join(".venv");
    let python = venv.join(if cfg!(windows) { "Scripts/python.exe" } else { "bin/python" });

    // The whole lock is the stamp: it is small, and equal text needs no hash function.
    let stamp_path = venv.join("made-from");
    let stamp = format!("{}\n{lock}", system.version);
    if python.is_file() && fs::read_to_string(&stamp_path).is_ok_and(|old| old == stamp) {
        return Ok(python);
    }

    stage("Python environment", Command::new(system.program).args(["-m", "venv", "--clear"]).arg(&venv))?;
    stage(
        "Python packages",
        Command::new(&python)
            .args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"])
            .args(["--require-hashes", "--no-deps", "--only-binary=:all:", "--requirement", LOCK]),
    )?;
    // Written last: an interrupted installation is made again.
    fs::write(&stamp_path, stamp)
        .map_err(|error| Failure::new(format!("{}: {error}", stamp_path.display())))?;
    Ok(python)
}

struct SystemPython {
    program: &'static OsStr,
    version: String,
}

/// The first Python on the path that is new enough, or a message that says what to install.
fn system_python() -> Result<SystemPython, Failure> {
    let mut found = Vec::new();
    for program in ["python3", "python"] {
        let program = OsStr::new(program);
        // "3.11.7 /usr", so that another installation of the same version makes the environment anew.
        let print = "import sys; print('%d.%d.%d' % sys.version_info[:3], sys.base_prefix)";
        let Ok(output) = Command::new(program).args(["-c", print]).output() else { continue };
        let version = String::from_utf8_lossy(&output.stdout).trim().to_owned();
        if output.status.success() && is_new_enough(&version) {
            return Ok(SystemPython { program, version });
        }
        found.push(format!("{} is {version:?}", program.display()));
    }
    let found = if found.is_empty() { "found none".to_owned() } else { found.join(", ") };
    Err(Failure::new(format!(
        "the Python tests need python3 {}.{} or newer on the path with its venv module ({found}); \
         they are part of the test command and are not skipped",
        OLDEST.0, OLDEST.1
    )))
}

fn is_new_enough(version: &str) -> bool {
    let mut numbers = version.split('.').map_while(|part| part.parse::<u32>().ok());
    match (numbers.next(), numbers.next()) {
        (Some(major), Some(minor)) => (major, minor) >= OLDEST,
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::is_new_enough;

    #[test]
    fn versions_compare_as_numbers() {
        assert!(is_new_enough("3.10.0 /usr"));
        assert!(is_new_enough("3.13.1 /usr"));
        assert!(!is_new_enough("3.9.18 /usr"));
        assert!(!is_new_enough("2.7.18 /usr"));
        assert!(!is_new_enough(""));
    }
}
