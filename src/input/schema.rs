//! A TOML value beside the schema that `schemars` derives from our structs: what of it the schema does not
//! allow.

use serde_json::Value as Json;
use toml::Value;

use super::Invalid;

/// The walk of a value beside the schema that `schemars` derives from our structs.
pub(super) struct Walk<'a> {
    root: &'a Json,
    pub(super) diagnostics: Vec<Invalid>,
}

impl<'a> Walk<'a> {
    pub(super) fn new(root: &'a Json) -> Self {
        Self { root, diagnostics: Vec::new() }
    }

    fn diagnostic(&mut self, path: &str, message: String) {
        self.diagnostics.push(Invalid::new(path, message));
    }

    pub(super) fn resolve(&self, schema: &'a Json) -> &'a Json {
        match schema.get("$ref").and_then(Json::as_str).and_then(|r| r.strip_prefix('#')) {
            Some(pointer) => self.root.pointer(pointer).map_or(schema, |target| self.resolve(target)),
            None => schema,
        }
    }

    pub(super) fn check(&mut self, schema: &'a Json, value: &Value, path: &str) {
        let bounds = schema;
        let schema = self.resolve(schema);
        if let Some(alternatives) = alternatives(schema) {
            self.check_alternatives(alternatives, value, path);
            return;
        }
        match value {
            Value::Table(table) => self.check_table(schema, table, path),
            Value::Array(items) => self.check_array(schema, items, path),
            Value::Integer(i) => self.check_number(schema, bounds, *i as f64, true, path),
            Value::Float(x) => self.check_number(schema, bounds, *x, false, path),
            Value::String(s) => {
                if let Some(allowed) = schema.get("enum").and_then(Json::as_array) {
                    if !allowed.iter().any(|a| a.as_str() == Some(s)) {
                        self.diagnostic(path, format!("\"{s}\" is not allowed; one of {}", list(allowed)));
                    }
                } else if !has_type(schema, "string") {
                    self.diagnostic(path, wrong_type(schema, "a string"));
                }
            }
            Value::Boolean(_) => {
                if !has_type(schema, "boolean") {
                    self.diagnostic(path, wrong_type(schema, "a boolean"));
                }
            }
            Value::Datetime(_) => self.diagnostic(path, wrong_type(schema, "a date")),
        }
    }

    fn check_alternatives(&mut self, alternatives: &'a [Json], value: &Value, path: &str) {
        let mut best: Option<Vec<Invalid>> = None;
        let mut constants = Vec::new();
        for alternative in alternatives {
            let alternative = self.resolve(alternative);
            if has_type(alternative, "null") {
                continue;
            }
            if let Some(constant) = alternative.get("const") {
                constants.push(constant.clone());
                if value.as_str() == constant.as_str() {
                    return;
                }
                continue;
            }
            let mut inner = Walk::new(self.root);
            inner.check(alternative, value, path);
            if inner.diagnostics.is_empty() {
                return;
            }
            if best.as_ref().is_none_or(|b| inner.diagnostics.len() < b.len()) {
                best = Some(inner.diagnostics);
            }
        }
        match best {
            Some(diagnostics) => self.diagnostics.extend(diagnostics),
            None => self.diagnostic(path, format!("{value} is not allowed; one of {}", list(&constants))),
        }
    }

    fn check_table(&mut self, schema: &'a Json, table: &toml::Table, path: &str) {
        if !has_type(schema, "object") {
            self.diagnostic(path, wrong_type(schema, "a table"));
            return;
        }
        let join = |key: &str| if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
        let properties = schema.get("properties").and_then(Json::as_object);
        for (key, value) in table {
            if let Some(property) = properties.and_then(|p| p.get(key)) {
                self.check(property, value, &join(key));
            } else {
                match schema.get("additionalProperties") {
                    Some(Json::Bool(false)) => {
                        let known = properties.map(|p| p.keys().map(String::as_str).collect::<Vec<_>>());
                        let known = known.unwrap_or_default().join(", ");
                        self.diagnostic(&join(key), format!("unknown key; known here: {known}"));
                    }
                    Some(inner @ Json::Object(_)) => self.check(inner, value, &join(key)),
                    _ => {}
                }
            }
        }
        for key in schema.get("required").and_then(Json::as_array).into_iter().flatten() {
            if let Some(key) = key.as_str().filter(|key| !table.contains_key(*key)) {
                self.diagnostic(&join(key), "missing".to_owned());
            }
        }
    }

    fn check_array(&mut self, schema: &'a Json, items: &[Value], path: &str) {
        if !has_type(schema, "array") {
            self.diagnostic(path, wrong_type(schema, "a list"));
            return;
        }
        let count = |key: &str| schema.get(key).and_then(Json::as_u64).map(|n| n as usize);
        let (least, most) = (count("minItems").unwrap_or(0), count("maxItems").unwrap_or(usize::MAX));
        if items.len() < least || items.len() > most {
            let expected = if least == most {
                format!("{least}")
            } else if most == usize::MAX {
                format!("at least {least}")
            } else {
                format!("{least} to {most}")
            };
            self.diagnostic(path, format!("expected {expected} entries, got {}", items.len()));
            return;
        }
        let prefix = schema.get("prefixItems").and_then(Json::as_array);
        for (i, item) in items.iter().enumerate() {
            if let Some(schema) = prefix.and_then(|p| p.get(i)).or_else(|| schema.get("items")) {
                self.check(schema, item, &format!("{path}.{i}"));
            }
        }
    }

    fn check_number(&mut self, schema: &Json, outer: &Json, x: f64, whole: bool, path: &str) {
        if !(has_type(schema, "number") || whole && has_type(schema, "integer")) {
            let what = if whole { "a whole number" } else { "a number with a fraction" };
            self.diagnostic(path, wrong_type(schema, what));
            return;
        }
        // A bound may stand beside the reference to a shared definition.
        let bound = |key: &str| outer.get(key).or_else(|| schema.get(key)).and_then(Json::as_f64);
        let (least, most) = (bound("minimum"), bound("maximum"));
        let inside =
            x.is_finite() && least.is_none_or(|least| x >= least) && most.is_none_or(|most| x <= most);
        if !inside {
            self.diagnostic(path, format!("{x} is out of range; allowed {}", range(least, most)));
        }
    }
}

pub(super) fn alternatives(schema: &Json) -> Option<&[Json]> {
    ["anyOf", "oneOf"].iter().find_map(|key| schema.get(*key)?.as_array().map(Vec::as_slice))
}

pub(super) fn has_type(schema: &Json, name: &str) -> bool {
    match schema.get("type") {
        Some(Json::String(s)) => s == name,
        Some(Json::Array(types)) => types.iter().any(|t| t == name),
        _ => false,
    }
}

fn wrong_type(schema: &Json, got: &str) -> String {
    let expected = match schema.get("type") {
        Some(Json::String(s)) => s.clone(),
        Some(Json::Array(types)) => types.iter().filter_map(Json::as_str).collect::<Vec<_>>().join(" or "),
        _ => "something else".to_owned(),
    };
    format!("expected {expected}, got {got}")
}

pub(super) fn list(values: &[Json]) -> String {
    values.iter().map(Json::to_string).collect::<Vec<_>>().join(", ")
}

pub(super) fn range(least: Option<f64>, most: Option<f64>) -> String {
    match (least, most) {
        (Some(a), Some(b)) => format!("{a} to {b}"),
        (Some(a), None) => format!("{a} or more"),
        (None, Some(b)) => format!("{b} or less"),
        (None, None) => "any finite number".to_owned(),
    }
}
