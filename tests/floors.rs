//! Floors of the house: a module imports only from above itself in `src/lib.rs`, subsystems do not
//! import each other, and the autopilot knows neither vehicle nor plant.

#![allow(clippy::disallowed_methods)] // this test reads the sources; the library reads nothing

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Subsystems take plain values; the plant alone wires them.
const SUBSYSTEMS: [&str; 6] = ["actuator", "disturbance", "dynamics", "fault", "propulsion", "sensor"];
/// What a flight computer could not see.
const HIDDEN_FROM_AUTOPILOT: [&str; 9] =
    ["actuator", "disturbance", "dynamics", "fault", "plant", "propulsion", "scenario", "sensor", "vehicle"];

fn source() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

/// Modules in the order in which `lib.rs` declares them.
fn floors() -> Vec<String> {
    let text = fs::read_to_string(source().join("lib.rs")).unwrap();
    text.lines()
        .filter_map(|line| line.strip_prefix("pub mod ")?.strip_suffix(';'))
        .map(str::to_owned)
        .collect()
}

/// Every file of a module.
fn files(module: &str) -> Vec<PathBuf> {
    let single = source().join(format!("{module}.rs"));
    if single.exists() {
        return vec![single];
    }
    let mut found = Vec::new();
    let mut folders = vec![source().join(module)];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                found.push(path);
            }
        }
    }
    assert!(!found.is_empty(), "no file for {module}");
    found
}

/// Top-level modules that a file names in code, comments left out: `crate::NAME` and the names in
/// `use crate::{…}`.
fn imports(path: &Path) -> BTreeSet<String> {
    let text = fs::read_to_string(path).unwrap();
    let code: String =
        text.lines().map(|line| line.split("//").next().unwrap_or("")).collect::<Vec<_>>().join("\n");
    let name = |s: &str| s.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    let mut found = BTreeSet::new();
    for (at, _) in code.match_indices("crate::") {
        let rest = &code[at + "crate::".len()..];
        if let Some(group) = rest.strip_prefix('{') {
            let mut depth = 0;
            let mut item = String::new();
            for c in group.chars() {
                match c {
                    '{' => depth += 1,
                    '}' if depth == 0 => break,
                    '}' => depth -= 1,
                    ',' if depth == 0 => {
                        found.insert(name(item.trim()));
                        item.clear();
                        continue;
                    }
                    _ => {}
                }
                item.push(c);
            }
            found.insert(name(item.trim()));
        } else {
            found.insert(name(rest));
        }
    }
    found.remove("");
    found
}

#[test]
fn a_module_imports_only_from_above_itself() {
    let floors = floors();
    assert!(floors.len() > 10, "lib.rs lists its modules: {floors:?}");
    let mut checked = 0;
    for (floor, module) in floors.iter().enumerate() {
        for path in files(module) {
            for import in imports(&path) {
                let Some(target) = floors.iter().position(|m| *m == import) else { continue };
                checked += 1;
                assert!(
                    target <= floor,
                    "{}: {module} imports {import}, which stands below it",
                    path.display()
                );
            }
        }
    }
    assert!(checked > 50, "only {checked} imports were seen");
}

#[test]
fn subsystems_do_not_import_each_other() {
    for module in SUBSYSTEMS {
        for path in files(module) {
            for import in imports(&path) {
                let other = SUBSYSTEMS.contains(&import.as_str()) && import != module;
                assert!(!other, "{}: {module} imports {import}", path.display());
            }
        }
    }
}

#[test]
fn the_autopilot_sees_measurements_and_nothing_else() {
    for path in files("autopilot") {
        for import in imports(&path) {
            assert!(
                !HIDDEN_FROM_AUTOPILOT.contains(&import.as_str()),
                "{}: the autopilot imports {import}",
                path.display()
            );
        }
    }
}
