//! Input files as data: TOML text becomes parameter structs, and whatever is wrong with it is said with
//! file, line, key and allowed range.
//!
//! The JSON schema that serves editors is derived from the same structs, and it is also what checks a
//! file: [`Document::read`] walks the values beside the schema before serde sees them. So a range is
//! written once, beside the field it bounds.

mod explain;
mod schema;

pub use explain::explain;

use std::fmt;
use std::path::Path;

use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use toml::Value;
use toml::de::{DeTable, DeValue};

use schema::Walk;

/// A parameter that contradicts another, found by a `validate` of a parameter struct.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{key}: {message}")]
pub struct Invalid {
    /// Dotted path of the key, relative to the struct that reports it.
    pub key: String,
    /// What is wrong, with the numbers.
    pub message: String,
}

impl Invalid {
    /// A contradiction at `key`.
    pub fn new(key: impl Into<String>, message: impl Into<String>) -> Self {
        Self { key: key.into(), message: message.into() }
    }

    /// The same, seen from the table `parent` that holds the struct.
    #[must_use]
    pub fn within(mut self, parent: &str) -> Self {
        self.key = if self.key.is_empty() { parent.to_owned() } else { format!("{parent}.{}", self.key) };
        self
    }
}

/// Everything that is wrong with one file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InputError {
    /// The file, as the caller named it.
    pub file: String,
    /// What is wrong, in the order of the file.
    pub diagnostics: Vec<Diagnostic>,
}

/// One thing that is wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// Line of the key or of the nearest table above it; `None` for a value that is in no file.
    pub line: Option<usize>,
    /// Dotted path of the key.
    pub key: String,
    /// What is wrong, with the numbers.
    pub message: String,
}

impl fmt::Display for InputError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, diagnostic) in self.diagnostics.iter().enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            write!(f, "{}:", self.file)?;
            if let Some(line) = diagnostic.line {
                write!(f, "{line}:")?;
            }
            if !diagnostic.key.is_empty() {
                write!(f, " {}:", diagnostic.key)?;
            }
            write!(f, " {}", diagnostic.message)?;
        }
        Ok(())
    }
}

impl std::error::Error for InputError {}

impl InputError {
    /// A file that cannot be used, for a reason that lies outside its values.
    pub fn of_file(file: impl Into<String>, message: impl Into<String>) -> Self {
        let diagnostic = Diagnostic { line: None, key: String::new(), message: message.into() };
        Self { file: file.into(), diagnostics: vec![diagnostic] }
    }
}

/// The text of a file, exactly as it was read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InputText {
    /// The file's path, as messages name it.
    pub file: String,
    /// What it holds.
    pub text: String,
}

impl InputText {
    /// Asks `read` for the text of the file at `path`.
    ///
    /// # Errors
    /// What `read` says, with the file's name.
    pub fn read<E: fmt::Display>(
        path: &Path,
        read: &mut impl FnMut(&Path) -> Result<String, E>,
    ) -> Result<Self, InputError> {
        let file = path.display().to_string();
        match read(path) {
            Ok(text) => Ok(Self { file, text }),
            Err(e) => Err(InputError::of_file(file, e.to_string())),
        }
    }

    /// The text as TOML.
    ///
    /// # Errors
    /// When it is none.
    pub fn document(&self) -> Result<Document, InputError> {
        Document::parse(&self.file, &self.text)
    }

    /// What is wrong at a line of a file that is no TOML.
    pub(crate) fn error_at(&self, line: usize, message: String) -> InputError {
        let diagnostic = Diagnostic { line: Some(line), key: String::new(), message };
        InputError { file: self.file.clone(), diagnostics: vec![diagnostic] }
    }
}

/// A TOML file with the overrides of the command line applied.
#[derive(Clone)]
pub struct Document {
    file: String,
    text: String,
    value: Value,
    overrides: Vec<Override>,
}

/// A value that the command line replaced.
#[derive(Clone)]
struct Override {
    /// Dotted path in this document.
    key: String,
    /// Where it was given: `--set KEY`, or the key of another file.
    given: String,
}

impl Document {
    /// Parses `text`; `file` is only a name for messages.
    pub fn parse(file: &str, text: &str) -> Result<Self, InputError> {
        match toml::from_str::<toml::Table>(text) {
            Ok(table) => Ok(Self {
                file: file.to_owned(),
                text: text.to_owned(),
                value: Value::Table(table),
                overrides: Vec::new(),
            }),
            Err(e) => Err(InputError {
                file: file.to_owned(),
                diagnostics: vec![Diagnostic {
                    line: e.span().map(|span| line_at(text, span.start)),
                    key: String::new(),
                    message: e.message().to_owned(),
                }],
            }),
        }
    }

    /// Name of the file.
    pub fn file(&self) -> &str {
        &self.file
    }

    /// Its text, without the values that replace its own.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The value of a top-level key.
    pub fn get(&self, key: &str) -> Option<&Value> {
        self.value.get(key)
    }

    /// Replaces or adds the value at the dotted path `key`; a number in the path indexes an array.
    /// Whether the key exists is judged by [`Document::read`].
    pub fn set(&mut self, key: &str, toml_value: &str) -> Result<(), InputError> {
        self.set_given(key, key, toml_value)
    }

    /// The same for a key that the user gave as `given`, with the file's prefix; messages quote that.
    pub fn set_given(&mut self, given: &str, key: &str, toml_value: &str) -> Result<(), InputError> {
        self.set_from("--set", given, key, toml_value)
    }

    /// The same for a key that stands as `given` in `place`, a file or the command line.
    pub(crate) fn set_from(
        &mut self,
        place: &str,
        given: &str,
        key: &str,
        toml_value: &str,
    ) -> Result<(), InputError> {
        let value = parse_value(toml_value).map_err(|message| InputError {
            file: place.to_owned(),
            diagnostics: vec![Diagnostic { line: None, key: given.to_owned(), message }],
        })?;
        self.put(place, given, key, value)
    }

    /// The same for a value that is not text.
    pub fn put(&mut self, place: &str, given: &str, key: &str, value: Value) -> Result<(), InputError> {
        let diagnostic = |message: String| InputError {
            file: place.to_owned(),
            diagnostics: vec![Diagnostic { line: None, key: given.to_owned(), message }],
        };
        let replaced = Override { key: key.to_owned(), given: format!("{place} {given}") };
        let mut at = &mut self.value;
        let mut parts = key.split('.').peekable();
        while let Some(part) = parts.next() {
            if part.is_empty() {
                return Err(diagnostic("an empty part in the dotted path".to_owned()));
            }
            let last = parts.peek().is_none();
            at = match at {
                Value::Table(table) => {
                    if last {
                        table.insert(part.to_owned(), value);
                        self.overrides.push(replaced);
                        return Ok(());
                    }
                    table.entry(part).or_insert_with(|| Value::Table(toml::Table::new()))
                }
                Value::Array(items) => {
                    let count = items.len();
                    let item =
                        part.parse::<usize>().ok().and_then(|i| items.get_mut(i)).ok_or_else(|| {
                            diagnostic(format!("'{part}' is no index into {count} entries"))
                        })?;
                    if last {
                        *item = value;
                        self.overrides.push(replaced);
                        return Ok(());
                    }
                    item
                }
                _ => return Err(diagnostic(format!("unknown key: '{part}' lies inside a plain value"))),
            };
        }
        Ok(())
    }

    /// Checks the document against the schema of `T` and deserialises it.
    pub fn read<T: DeserializeOwned + JsonSchema>(&self) -> Result<T, InputError> {
        let schema = schemars::schema_for!(T);
        let mut walk = Walk::new(schema.as_value());
        walk.check(schema.as_value(), &self.value, "");
        if !walk.diagnostics.is_empty() {
            return Err(self.error(walk.diagnostics));
        }
        serde_path_to_error::deserialize(self.value.clone()).map_err(|e| {
            let key = e.path().to_string();
            self.error(vec![Invalid::new(key, e.into_inner().message().to_owned())])
        })
    }

    /// Contradictions found later, by a `validate`, with the lines of this document.
    pub fn error(&self, contradictions: Vec<Invalid>) -> InputError {
        let mut diagnostics: Vec<Diagnostic> = contradictions
            .into_iter()
            .map(|invalid| {
                // Array indices may come as `a[3].b`; lines are found by `a.3.b`.
                let key = invalid.key.replace('[', ".").replace(']', "");
                let by = self.overrides.iter().find(|o| {
                    o.key == key
                        || o.key.starts_with(&format!("{key}."))
                        || key.starts_with(&format!("{}.", o.key))
                });
                match by {
                    Some(by) => Diagnostic {
                        line: None,
                        message: format!("{} (given by {})", invalid.message, by.given),
                        key,
                    },
                    None => Diagnostic { line: self.line_of(&key), message: invalid.message, key },
                }
            })
            .collect();
        diagnostics.sort_by_key(|diagnostic| diagnostic.line);
        InputError { file: self.file.clone(), diagnostics }
    }

    /// File and line of the key at a path, or of the nearest table above it: `FILE:LINE`.
    pub fn place_of(&self, path: &[&str]) -> String {
        match self.line_at_path(path.iter().copied()) {
            Some(line) => format!("{}:{line}", self.file),
            None => self.file.clone(),
        }
    }

    fn line_of(&self, dotted: &str) -> Option<usize> {
        self.line_at_path(dotted.split('.'))
    }

    /// Line of the key at a path, or of the nearest table above it that the text has.
    fn line_at_path<'a>(&self, path: impl Iterator<Item = &'a str>) -> Option<usize> {
        let table = DeTable::parse(&self.text).ok()?;
        let mut offset = None;
        let mut at: Option<&DeValue<'_>> = None;
        for part in path {
            let found = match at {
                None => table.get_ref().get_key_value(part),
                Some(DeValue::Table(inner)) => inner.get_key_value(part),
                Some(DeValue::Array(items)) => {
                    let item = part.parse::<usize>().ok().and_then(|i| items.get(i));
                    let Some(item) = item else { break };
                    offset = Some(item.span().start);
                    at = Some(item.get_ref());
                    continue;
                }
                Some(_) => None,
            };
            let Some((key, value)) = found else { break };
            offset = Some(key.span().start);
            at = Some(value.get_ref());
        }
        offset.map(|offset| line_at(&self.text, offset))
    }
}

fn line_at(text: &str, offset: usize) -> usize {
    text.as_bytes().iter().take(offset).filter(|&&b| b == b'\n').count() + 1
}

fn parse_value(text: &str) -> Result<Value, String> {
    let table = toml::from_str::<toml::Table>(&format!("v = {text}"))
        .map_err(|e| format!("'{text}' is not a TOML value: {}", e.message()))?;
    let mut values = table.into_iter();
    match (values.next(), values.next()) {
        (Some((_, value)), None) => Ok(value),
        _ => Err(format!("'{text}' is not one TOML value")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, Deserialize, JsonSchema)]
    #[serde(deny_unknown_fields)]
    struct Outer {
        inner: Inner,
        #[serde(default)]
        parts: Vec<Inner>,
        choice: Choice,
        spare: Option<Inner>,
        second: Option<Choice>,
    }

    #[derive(Debug, Deserialize, JsonSchema)]
    #[serde(deny_unknown_fields)]
    struct Inner {
        /// Length of the thing.
        #[schemars(range(min = 0.01, max = 2.0))]
        length_m: f64,
        #[serde(default)]
        #[schemars(inner(range(min = -1.0, max = 1.0)))]
        axis: [f64; 3],
    }

    #[derive(Debug, Deserialize, JsonSchema, PartialEq)]
    #[serde(rename_all = "snake_case")]
    enum Choice {
        /// One.
        FirstKind,
        /// Two.
        SecondKind,
    }

    const GOOD: &str = "choice = \"first_kind\"\n[inner]\nlength_m = 1 # whole numbers are fine\n\
                        [[parts]]\nlength_m = 0.5\n[[parts]]\nlength_m = 0.6\naxis = [0, 0.5, 1]\n";

    fn message(text: &str) -> String {
        Document::parse("f.toml", text).and_then(|d| d.read::<Outer>()).unwrap_err().to_string()
    }

    #[test]
    fn a_good_file_is_read() {
        let outer: Outer = Document::parse("f.toml", GOOD).unwrap().read().unwrap();
        assert_eq!((outer.inner.length_m, outer.parts[1].axis[1]), (1.0, 0.5));
        assert_eq!(outer.choice, Choice::FirstKind);
        assert!(outer.spare.is_none() && outer.second.is_none());
    }

    #[test]
    fn messages_name_file_line_key_and_range() {
        let out_of_range = GOOD.replace("0.6", "9.0");
        assert_eq!(
            message(&out_of_range),
            "f.toml:7: parts.1.length_m: 9 is out of range; allowed 0.01 to 2"
        );
        assert_eq!(
            message(&GOOD.replace("0.5, 1]", "0.5, 7]")),
            "f.toml:8: parts.1.axis.2: 7 is out of range; allowed -1 to 1"
        );
        assert_eq!(
            message(&GOOD.replace("first_kind", "x")),
            "f.toml:1: choice: \"x\" is not allowed; one of \"first_kind\", \"second_kind\""
        );
        assert_eq!(
            message(&GOOD.replace("= 0.5", "= nan")),
            "f.toml:5: parts.0.length_m: NaN is out of range; allowed 0.01 to 2"
        );
        assert_eq!(
            message(&GOOD.replace("= 0.5", "= \"a\"")),
            "f.toml:5: parts.0.length_m: expected number, got a string"
        );
        assert!(
            message(&GOOD.replace("axis", "axes"))
                .starts_with("f.toml:8: parts.1.axes: unknown key; known here:")
        );
        assert_eq!(message("choice = \"first_kind\"\n[inner]\n"), "f.toml:2: inner.length_m: missing");
        assert!(message("choice = \n").starts_with("f.toml:1:"));
    }

    #[test]
    fn an_override_is_judged_like_the_file_and_named() {
        let mut d = Document::parse("f.toml", GOOD).unwrap();
        d.set("parts.1.length_m", "0.7").unwrap();
        assert_eq!(d.read::<Outer>().unwrap().parts[1].length_m, 0.7);
        d.set("inner.lenght_m", "0.7").unwrap();
        let e = d.read::<Outer>().unwrap_err().to_string();
        assert!(e.starts_with("f.toml: inner.lenght_m: unknown key"), "{e}");
        assert!(e.ends_with("(given by --set inner.lenght_m)"), "{e}");
        assert!(d.set("inner.length_m.x", "1").is_err());
        assert!(d.set("parts.9.length_m", "1").is_err());
        assert!(d.set("inner.length_m", "1\nx = 2").is_err());
    }

    #[test]
    fn a_key_is_explained_from_the_schema() {
        let text = explain(&schemars::schema_for!(Outer), "inner.length_m").unwrap();
        assert!(text.contains("Length of the thing.") && text.contains("allowed: 0.01 to 2"), "{text}");
        let list = explain(&schemars::schema_for!(Outer), "inner.axis").unwrap();
        assert!(list.contains("allowed: -1 to 1 each"), "{list}");
        assert!(explain(&schemars::schema_for!(Outer), "spare.length_m").is_some());
        assert!(explain(&schemars::schema_for!(Outer), "inner.nothing").is_none());
        for key in ["choice", "second"] {
            let choice = explain(&schemars::schema_for!(Outer), key).unwrap();
            let listed = "one of: \"first_kind\", \"second_kind\"\n\
                          \x20   \"first_kind\": One.\n    \"second_kind\": Two.";
            assert!(choice.contains(listed), "{choice}");
        }
    }
}
