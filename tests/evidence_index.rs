//! The index of evidence, tests/README.md, against what exists: it cannot name a test, a script or a file
//! that is not there, nor leave out an equation or a correction.

#![allow(clippy::disallowed_methods)] // the test reads the repository

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use hopbench::event::{self, AbortReason, EventKind, Phase};
use hopbench::fault::catalogue;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn text(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Everything between backticks.
fn quoted(text: &str) -> Vec<&str> {
    text.lines().flat_map(|line| line.split('`').skip(1).step_by(2)).collect()
}

/// Names of the test functions of a source file, those of `proptest!` too.
fn tests_of(source: &str) -> BTreeSet<&str> {
    let mut names = BTreeSet::new();
    let mut marked = false;
    for line in source.lines().map(str::trim_start) {
        if line.starts_with("#[test]") {
            marked = true;
        } else if let Some(rest) = line.strip_prefix("fn ").filter(|_| marked) {
            names.insert(rest.split('(').next().unwrap_or_default());
            marked = false;
        }
    }
    names
}

#[test]
fn every_test_and_file_that_the_index_names_exists() {
    let index = text(&root().join("tests/README.md"));
    let (mut tests, mut files) = (0, 0);
    for name in quoted(&index) {
        if let Some((file, function)) = name.split_once("::") {
            if function == "name" {
                continue;
            }
            let path = if file.ends_with(".rs") {
                root().join(file)
            } else {
                root().join(format!("tests/{file}.rs"))
            };
            assert!(tests_of(&text(&path)).contains(function), "{name}: no such test in {}", path.display());
            tests += 1;
        } else if ["tests/", "tools/", "src/", "scenarios/", "hil/", "docs/"]
            .iter()
            .any(|folder| name.starts_with(folder))
        {
            // Names that stand for any file.
            if !name.contains("file.rs") && name != "src/path.rs" {
                assert!(root().join(name).exists(), "{name} does not exist");
                files += 1;
            }
        }
    }
    assert!(tests > 60 && files > 40, "{tests} tests and {files} files are named");
}

/// First cells of the tables below a heading.
fn first_cells<'a>(index: &'a str, heading: &str) -> BTreeSet<&'a str> {
    let section =
        index.split("\n## ").find(|section| section.starts_with(heading)).expect("the heading exists");
    section.lines().filter_map(|line| line.strip_prefix("| ")?.split(" |").next()).collect()
}

#[test]
fn no_equation_and_no_correction_is_missing() {
    let index = text(&root().join("tests/README.md"));
    for (heading, last) in [("The seed paper's equations", 22), ("Corrections of the seed paper", 19)] {
        let cells = first_cells(&index, heading);
        for number in 1..=last {
            assert!(cells.contains(number.to_string().as_str()), "{heading}: {number} is missing");
        }
    }
}

#[test]
fn every_data_file_names_its_maker() {
    let index = text(&root().join("tests/README.md"));
    let mut count = 0;
    for file in std::fs::read_dir(root().join("tests/reference")).expect("the folder exists") {
        let path = file.expect("an entry").path();
        if path.extension().is_none_or(|extension| extension != "csv") {
            continue;
        }
        let (text, name) = (text(&path), path.file_name().unwrap_or_default().to_string_lossy().into_owned());
        // A schedule that both codes read is nobody's result.
        if name.ends_with("_commands.csv") {
            continue;
        }
        let heading: String = text.lines().take_while(|line| line.starts_with('#')).collect();
        let script = heading.split("tools/reference/").nth(1).and_then(|rest| rest.split(".py").next());
        let script = script.unwrap_or_else(|| panic!("{name}: its heading names no script"));
        assert!(
            root().join(format!("tools/reference/{script}.py")).exists(),
            "{name}: no script {script}.py"
        );
        assert!(
            index.contains(&name) || name == "paper_mode_commands.csv",
            "{name} is not in tests/README.md"
        );
        count += 1;
    }
    assert!(count > 15, "{count} files");
}

/// Every fault of the catalogue stands in the table of README.md once, with its range, and names a test for
/// it that exists.
#[test]
fn the_table_of_faults_is_the_catalogue() {
    let readme = text(&root().join("README.md"));
    let section = readme.split("\n## ").find(|section| section.starts_with("Faults\n")).unwrap();
    let mut missing: Vec<_> = catalogue().map(|row| (row.component.name(), row.mode.name(), row)).collect();
    let mut seen = BTreeSet::new();
    for line in section.lines().filter(|line| line.starts_with("| `")) {
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        let [components, mode, value, _, tests] = cells[..] else { panic!("{line}") };
        let mode = quoted(mode)[0];
        for component in quoted(components) {
            assert!(seen.insert((component, mode)), "{component} {mode} stands there twice");
            let at = missing.iter().position(|(c, m, _)| (*c, *m) == (component, mode));
            let (_, _, row) = missing.remove(at.unwrap_or_else(|| panic!("no fault {component} {mode}")));
            let expected = row.value.map_or("–".to_owned(), |q| {
                format!("{} to {} {}; {}", q.least, q.greatest, q.unit, q.default)
            });
            assert_eq!(value, expected, "{component} {mode}");
            let own = format!("{component}_{mode}");
            let named = quoted(tests).into_iter().any(|test| {
                let (file, function) = test.split_once("::").unwrap_or_else(|| panic!("{test}"));
                let of_this = function == own || function == format!("sensor_{mode}");
                of_this && tests_of(&text(&root().join(file))).contains(function)
            });
            assert!(named, "{component} {mode}: no test of it in {tests}");
        }
    }
    let missing: Vec<_> = missing.iter().map(|(component, mode, _)| (component, mode)).collect();
    assert!(missing.is_empty(), "not in the table: {missing:?}");
}

/// The words in backticks of the one paragraph that begins so.
fn listed<'a>(page: &'a str, begin: &str) -> Vec<&'a str> {
    let paragraph = page.split("\n\n").find(|paragraph| paragraph.starts_with(begin)).expect("the paragraph");
    quoted(paragraph.split('.').next().unwrap_or_default())
}

#[test]
fn the_table_of_events_is_the_enum() {
    let page = text(&root().join("docs/events.md"));
    let table: Vec<&str> = page.lines().filter(|line| line.starts_with("| `")).collect();
    let rows = event::catalogue()
        .map(|row| format!("| `{}` | {} | {} |", row.name, row.severity.name(), row.meaning))
        .collect::<Vec<_>>();
    assert_eq!(table, rows);
    assert_eq!(listed(&page, "Phases"), Phase::ALL.map(Phase::name));
    assert_eq!(listed(&page, "Reasons"), AbortReason::ALL.map(AbortReason::name));
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("the folder exists") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|end| end == "rs") {
            found.push(path);
        }
    }
}

#[test]
fn every_event_is_emitted() {
    let mut files = Vec::new();
    sources(&root().join("src"), &mut files);
    sources(&root().join("hil/src"), &mut files);
    let code: String = files
        .iter()
        .flat_map(|path| text(path).split_whitespace().collect::<String>().into_bytes())
        .map(char::from)
        .collect();
    for row in event::catalogue() {
        let name = row.name.replace("REASON", "tilt").replace(":NAME", ":hover");
        let kind: EventKind = name.parse().unwrap_or_else(|unknown| panic!("{unknown}"));
        assert_eq!((kind.name().as_ref(), kind.severity()), (name.as_str(), row.severity));
        let debug = format!("{kind:?}");
        let variant = debug.split('(').next().unwrap_or_default();
        let emitted = ["event(", "note(", "kind:", "kind="].iter().any(|by| {
            let call = format!("{by}EventKind::{variant}");
            code.match_indices(&call)
                .any(|(at, call)| !code[at + call.len()..].starts_with(|next: char| next.is_alphanumeric()))
        });
        assert!(emitted, "{name} is never emitted");
    }
}
