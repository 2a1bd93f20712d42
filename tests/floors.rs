//! Floors of the house: a module imports only from above itself in `lib.rs`, in `src` and in `hil/src`, and
//! so do the rooms of a wing in its `mod.rs`; subsystems do not import each other; the autopilot knows
//! neither vehicle nor plant; nowhere do modules of one folder import each other in a circle.
//!
//! Not seen: what a folder's own `mod.rs` imports and what imports it, so a circle through it; `main.rs`;
//! what stands in tests; a path that a macro makes up.

#![allow(clippy::disallowed_methods)] // this test reads the sources; the library reads nothing

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fs;
use std::path::{Path, PathBuf};

/// Subsystems take plain values; the plant alone wires them.
const SUBSYSTEMS: [&str; 6] = ["actuator", "disturbance", "dynamics", "fault", "propulsion", "sensor"];
/// What a flight computer could not see.
const HIDDEN_FROM_AUTOPILOT: [&str; 9] =
    ["actuator", "disturbance", "dynamics", "fault", "plant", "propulsion", "scenario", "sensor", "vehicle"];
/// Folders of hil whose rooms stand in order too, each as its path.
const WINGS: [&[&str]; 6] =
    [&["wire"], &["bench"], &["evidence"], &["evidence", "campaign"], &["doctor"], &["px4"]];

/// The source folders of the two packages.
fn src() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

fn hil() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("hil/src")
}

#[test]
fn a_module_imports_only_from_above_itself() {
    let imports = imports(&House::read(&src()));
    check_order(&imports, &[], &declared(&src().join("lib.rs")), 50);
}

#[test]
fn a_room_of_the_bench_imports_only_from_above_itself() {
    let imports = imports(&House::read(&hil()));
    check_order(&imports, &[], &declared(&hil().join("lib.rs")), 20);
    for wing in WINGS {
        let folder: PathBuf = wing.iter().collect();
        check_order(&imports, wing, &declared(&hil().join(folder).join("mod.rs")), 3);
    }
}

#[test]
fn subsystems_do_not_import_each_other() {
    for import in imports(&House::read(&src())) {
        let [from, to] = [&import.from, &import.to].map(|module| module[0].as_str());
        assert!(from == to || !(SUBSYSTEMS.contains(&from) && SUBSYSTEMS.contains(&to)), "{import}");
    }
}

#[test]
fn the_autopilot_sees_measurements_and_nothing_else() {
    for import in imports(&House::read(&src())).iter().filter(|import| import.from[0] == "autopilot") {
        assert!(!HIDDEN_FROM_AUTOPILOT.contains(&import.to[0].as_str()), "{import}");
    }
}

#[test]
fn no_modules_of_a_folder_import_each_other_in_a_circle() {
    let mut circles = Vec::new();
    for folder in [src(), hil()] {
        let imports = imports(&House::read(&folder));
        assert!(imports.len() > 100, "only {} imports were seen", imports.len());
        circles.extend(circles_of(&imports));
    }
    assert!(circles.is_empty(), "{} circles:\n{}", circles.len(), circles.join("\n"));
}

/// A module by its path from the root of the package: `["propulsion", "engine"]`.
type Module = Vec<String>;

/// One module names another.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Import {
    from: Module,
    to: Module,
}

impl std::fmt::Display for Import {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} imports {}", self.from.join("::"), self.to.join("::"))
    }
}

/// Rooms of a folder import only from those declared above them.
fn check_order(imports: &[Import], folder: &[&str], order: &[String], least: usize) {
    let mut count = 0;
    for import in imports {
        let Some((from, to)) = rooms(import, folder.len()).filter(|_| import.from[..folder.len()] == *folder)
        else {
            continue;
        };
        let floor = |room: &str| order.iter().position(|name| name == room);
        let (Some(floor), Some(target)) = (floor(from), floor(to)) else { continue };
        count += 1;
        assert!(target < floor, "{import}, which stands below it");
    }
    assert!(count >= least, "{folder:?}: only {count} imports were seen");
}

/// The two rooms of one folder, `depth` levels down, that an import joins, if it joins two.
fn rooms(import: &Import, depth: usize) -> Option<(&str, &str)> {
    let (from, to) = (import.from.get(depth)?, import.to.get(depth)?);
    (from != to && import.from[..depth] == import.to[..depth]).then_some((from, to))
}

/// Every circle of every folder, each by its shortest way round: `propulsion: engine -> valve -> engine`.
fn circles_of(imports: &[Import]) -> Vec<String> {
    let mut folders: BTreeMap<&[String], BTreeMap<&str, BTreeSet<&str>>> = BTreeMap::new();
    for import in imports {
        for depth in 0..import.from.len() {
            if let Some((from, to)) = rooms(import, depth) {
                folders.entry(&import.from[..depth]).or_default().entry(from).or_default().insert(to);
            }
        }
    }
    let mut circles = Vec::new();
    for (folder, edges) in &folders {
        let mut named = BTreeSet::new();
        for room in edges.keys() {
            let Some(way) = shortest_way_round(room, edges) else { continue };
            // A circle of three is found from each of its rooms: told once.
            if named.insert(way.iter().collect::<BTreeSet<_>>().into_iter().copied().collect::<Vec<_>>()) {
                let folder = if folder.is_empty() { "lib".to_owned() } else { folder.join("::") };
                circles.push(format!("{folder}: {} -> {room}", way.join(" -> ")));
            }
        }
    }
    circles
}

/// The rooms passed from a room back to itself, itself first.
fn shortest_way_round<'a>(
    room: &'a str,
    edges: &BTreeMap<&'a str, BTreeSet<&'a str>>,
) -> Option<Vec<&'a str>> {
    let mut ways = VecDeque::from([vec![room]]);
    let mut reached = BTreeSet::new();
    while let Some(way) = ways.pop_front() {
        for next in edges.get(way.last()?).into_iter().flatten() {
            if *next == room {
                return Some(way);
            }
            if reached.insert(*next) {
                ways.push_back(way.iter().chain([next]).copied().collect());
            }
        }
    }
    None
}

/// Modules in the order in which a file declares them.
fn declared(file: &Path) -> Vec<String> {
    let text = fs::read_to_string(file).unwrap();
    let name = |line: &str| {
        line.trim_start_matches("pub ").strip_prefix("mod ")?.strip_suffix(';').map(str::to_owned)
    };
    text.lines().filter_map(name).collect()
}

/// The modules of a package and every path that their code names, tests left out.
struct House {
    named: BTreeMap<Module, Vec<Named>>,
}

impl House {
    fn read(folder: &Path) -> Self {
        let mut house = Self { named: BTreeMap::new() };
        house.read_folder(folder, &[]);
        house
    }

    fn read_folder(&mut self, folder: &Path, module: &[String]) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
            let inner: Module = module.iter().cloned().chain([name.clone()]).collect();
            if path.is_dir() {
                self.read_folder(&path, &inner);
            } else if path.extension().is_some_and(|e| e == "rs") && name != "tests" && name != "main" {
                let module = if name == "mod" || name == "lib" { module.to_vec() } else { inner };
                self.add(module, &fs::read_to_string(&path).unwrap());
            }
        }
    }

    fn add(&mut self, module: Module, text: &str) {
        self.named.insert(module, paths(&without_tests(words(text))));
    }

    /// The module whose item a path is, seen from a module: through what `mod.rs` hands on (`pub use`) to
    /// where it is defined. `None` for other packages and for what a module names of its own.
    fn target(&self, from: &[String], path: &[String]) -> Option<Module> {
        let mut path = self.absolute(from, path)?;
        // A chain of three is long; the bound ends a name that stands for itself.
        for _ in 0..8 {
            let depth = (0..=path.len()).rev().find(|depth| self.named.contains_key(&path[..*depth]))?;
            let (module, rest) = path.split_at(depth);
            let passed_on = rest.first().and_then(|name| {
                let mut uses = self.named[module].iter().filter(|named| named.is_use);
                let found = uses.find(|named| named.path.last() == Some(name))?;
                self.absolute(module, &found.path).filter(|found| found[..] != path[..=depth])
            });
            match passed_on {
                Some(found) => path = found.into_iter().chain(rest[1..].iter().cloned()).collect(),
                None => return Some(module.to_vec()),
            }
        }
        None
    }

    /// A path from the root of the package.
    fn absolute(&self, from: &[String], path: &[String]) -> Option<Module> {
        let (mut at, mut rest) = (from.to_vec(), path);
        match path.first()?.as_str() {
            "crate" => (at, rest) = (Module::new(), &path[1..]),
            "self" => rest = &path[1..],
            "super" => {
                while rest.first().is_some_and(|word| word == "super") {
                    at.pop()?;
                    rest = &rest[1..];
                }
            }
            child => {
                at.push(child.to_owned());
                self.named.contains_key(&at).then_some(())?;
                rest = &path[1..];
            }
        }
        Some(at.into_iter().chain(rest.iter().cloned()).collect())
    }
}

/// What imports what, each once; imports of a folder's own `mod.rs` and by it are left out: they join no two
/// rooms.
fn imports(house: &House) -> Vec<Import> {
    let mut found = BTreeSet::new();
    for (from, paths) in &house.named {
        for named in paths {
            if let Some(to) = house.target(from, &named.path).filter(|to| !to.is_empty() && !from.is_empty())
            {
                found.insert(Import { from: from.clone(), to });
            }
        }
    }
    found.into_iter().collect()
}

/// A path that code names.
struct Named {
    path: Vec<String>,
    is_use: bool,
}

/// Every path of `use`, groups spelled out, and every other one that begins at `crate`, `super` or `self`.
fn paths(code: &[String]) -> Vec<Named> {
    let mut found = Vec::new();
    let mut at = 0;
    while at < code.len() {
        let rest = &code[at..];
        let is_use = rest[0] == "use";
        if is_use {
            let mut group = Vec::new();
            at += 1 + tree(&rest[1..], &[], &mut group);
            found.extend(group.into_iter().map(|path| Named { path, is_use }));
        } else if ["crate", "super", "self"].contains(&rest[0].as_str()) {
            // A name, then `::` and a name as often as they come.
            let further = rest[1..].chunks_exact(2).take_while(|pair| pair[0] == "::" && is_name(&pair[1]));
            let path: Vec<_> = rest[..1].iter().chain(further.map(|pair| &pair[1])).cloned().collect();
            at += 2 * path.len() - 1;
            found.push(Named { path, is_use });
        } else {
            at += 1;
        }
    }
    found
}

/// The paths of one tree of `use`; how many words it takes.
fn tree(code: &[String], before: &[String], found: &mut Vec<Vec<String>>) -> usize {
    let mut path = before.to_vec();
    let mut at = 0;
    while let Some(word) = code.get(at) {
        match word.as_str() {
            ";" | "," | "}" => break,
            "{" => {
                at += 1;
                while code.get(at).is_some_and(|word| word != "}") {
                    at += tree(&code[at..], &path, found);
                    at += usize::from(code.get(at).is_some_and(|word| word == ","));
                }
                return at + 1;
            }
            // The module itself in a group: `pace::{self, now_ns}`.
            "self" if !path.is_empty() => {}
            "as" => at += 1,
            "::" => {}
            name => path.push(name.to_owned()),
        }
        at += 1;
    }
    found.push(path);
    at
}

fn is_name(word: &str) -> bool {
    word.starts_with(|c: char| c.is_alphabetic() || c == '_')
}

/// Names, `::` and single signs of a source file; comments, texts and characters are left out.
fn words(text: &str) -> Vec<String> {
    let mut words = Vec::new();
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let length = if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if rest.starts_with("/*") {
            rest.find("*/").map_or(rest.len(), |end| end + 2)
        } else if let Some(length) = quoted(rest) {
            length
        } else if first.is_alphanumeric() || first == '_' {
            let length = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
            words.push(rest[..length].to_owned());
            length
        } else {
            let length = if rest.starts_with("::") { 2 } else { first.len_utf8() };
            if !first.is_whitespace() {
                words.push(rest[..length].to_owned());
            }
            length
        };
        rest = &rest[length..];
    }
    words
}

/// How long the text or the character is that stands here, its quotes included.
fn quoted(code: &str) -> Option<usize> {
    let raw = code.strip_prefix("br").or(code.strip_prefix('r')).unwrap_or("");
    let hashes = raw.bytes().take_while(|b| *b == b'#').count();
    if raw[hashes..].starts_with('"') {
        let start = code.len() - raw.len() + hashes + 1;
        let end = format!("\"{}", "#".repeat(hashes));
        return Some(code[start..].find(&end).map_or(code.len(), |length| start + length + end.len()));
    }
    let mark = code.chars().next().filter(|c| "\"'".contains(*c))?;
    let mut escaped = false;
    for (at, c) in code.char_indices().skip(1) {
        if c == mark && !escaped {
            return Some(at + 1);
        }
        // One character, or the escape of one, stands between single quotes; all else is a lifetime.
        if mark == '\'' && at > 1 && !code[1..].starts_with('\\') {
            return None;
        }
        escaped = c == '\\' && !escaped;
    }
    None
}

/// What `#[cfg(test)]` stands before, left out: to its semicolon, or to the brace that closes it.
fn without_tests(words: Vec<String>) -> Vec<String> {
    let mark = ["#", "[", "cfg", "(", "test", ")", "]"];
    let mut kept = Vec::new();
    let mut at = 0;
    while at < words.len() {
        if !words[at..].starts_with(&mark.map(str::to_owned)) {
            kept.push(words[at].clone());
            at += 1;
            continue;
        }
        let mut depth = 0;
        while at < words.len() {
            depth += i32::from(words[at] == "{") - i32::from(words[at] == "}");
            at += 1;
            if depth == 0 && [";", "}"].contains(&words[at - 1].as_str()) {
                break;
            }
        }
    }
    kept
}

/// The checker itself, on made-up sources.
mod checker {
    use super::*;

    /// A package of three modules in one folder, the first with this text.
    fn house(text: &str) -> House {
        let mut house = House { named: BTreeMap::new() };
        for (module, text) in [
            ("room::a", text),
            ("room::b", "pub struct B; pub mod nothing {}"),
            ("room::c", "use super::a::A;"),
            ("room", "pub mod a; pub mod b; mod c; pub use c::Inner; pub struct Own;"),
            ("hall", ""),
        ] {
            house.add(module.split("::").map(str::to_owned).collect(), text);
        }
        house
    }

    /// What `room::a` imports, in one line.
    fn seen(text: &str) -> String {
        let imports = imports(&house(text));
        let of_a = imports.iter().filter(|import| import.from.join("::") == "room::a");
        of_a.map(|import| import.to.join("::")).collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn an_import_is_seen_however_it_is_written() {
        for (text, expected) in [
            ("use super::b::B;", "room::b"),
            ("use super::{b::B, c};", "room::b room::c"),
            ("use crate::{hall, room::{b::{self, B}, c::Inner as Other}};", "hall room::b room::c"),
            ("pub(crate) use super::super::hall::{X, Y};", "hall"),
            ("fn f() { super::b::g(crate::hall::H) }", "hall room::b"),
            ("use super::Inner;", "room::c"), // what the folder hands on
            ("use super::Own;", "room"),
            ("fn f<'a>(x: &'a str) -> char { '\"' } use super::b;", "room::b"),
        ] {
            assert_eq!(seen(text), expected, "{text}");
        }
    }

    #[test]
    fn comments_texts_tests_and_other_packages_are_no_imports() {
        for text in [
            "// use super::b;\n/* use super::b; */",
            "const TEXT: &str = \"use super::b; \\\" use super::c;\";",
            "const TEXT: &str = r#\"use super::b; \" super::c::d\"#;",
            "#[cfg(test)]\nmod tests { use super::super::b; fn f() { super::super::c::g() } }",
            "#[cfg(test)] use super::b;",
            "use std::b; use other::room::b;",
        ] {
            assert_eq!(seen(text), "", "{text}");
        }
        let after = "#[cfg(test)]\nmod tests { fn f() {} }\nuse super::b;";
        assert_eq!(seen(after), "room::b", "what stands after the tests counts again");
    }

    #[test]
    fn circles_are_named_all_at_once() {
        assert!(circles_of(&imports(&house("use super::b::B;"))).is_empty());
        let mut house = house("use super::c::C; use crate::hall;");
        house.add(vec!["hall".to_owned()], "fn f() { crate::room::b::g() }");
        assert_eq!(circles_of(&imports(&house)), ["lib: hall -> room -> hall", "room: a -> c -> a"]);
    }

    #[test]
    #[should_panic = "room::a imports room::b, which stands below it"]
    fn an_import_from_below_is_refused() {
        let order = ["a", "b", "c"].map(str::to_owned);
        check_order(&imports(&house("use super::b;")), &["room"], &order, 1);
    }
}
