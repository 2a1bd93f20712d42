//! What a schema says of one key, for whoever asks.

use schemars::Schema;
use serde_json::Value as Json;

use super::schema::{Walk, alternatives, has_type, list, range};

/// What a schema says of the key at a dotted path: description, type, range, default.
pub fn explain(schema: &Schema, path: &str) -> Option<String> {
    let root = schema.as_value();
    let walk = Walk::new(root);
    let mut outer = root;
    let mut node = root;
    for part in path.split('.') {
        let next = walk.resolve(node);
        let next = alternatives(next)
            .and_then(|all| {
                all.iter().map(|a| walk.resolve(a)).find(|a| has_type(a, "object") || has_type(a, "array"))
            })
            .unwrap_or(next);
        outer = if part.parse::<usize>().is_ok() && has_type(next, "array") {
            next.get("items")?
        } else {
            let table = if has_type(next, "array") { walk.resolve(next.get("items")?) } else { next };
            table.get("properties")?.get(part)?
        };
        node = walk.resolve(outer);
    }
    let either = |key: &str| outer.get(key).or_else(|| node.get(key));
    let mut lines = vec![path.to_owned()];
    if let Some(text) = either("description").and_then(Json::as_str) {
        lines.push(format!("  {}", text.replace('\n', "\n  ")));
    }
    let bound = |key: &str| either(key).and_then(Json::as_f64);
    if bound("minimum").is_some() || bound("maximum").is_some() {
        lines.push(format!("  allowed: {}", range(bound("minimum"), bound("maximum"))));
    }
    // Bounds of the elements of a list.
    let item = either("items").map(|items| walk.resolve(items));
    let item_bound = |key: &str| item.and_then(|item| item.get(key)).and_then(Json::as_f64);
    let (least, most) = (item_bound("minimum"), item_bound("maximum"));
    if least.is_some() || most.is_some() {
        lines.push(format!("  allowed: {} each", range(least, most)));
    }
    let choices = choices(&walk, node);
    if !choices.is_empty() {
        let values: Vec<Json> = choices.iter().map(|(value, _)| value.clone()).collect();
        lines.push(format!("  one of: {}", list(&values)));
        let described = choices.iter().filter_map(|(value, text)| Some((value, (*text)?)));
        lines.extend(described.map(|(value, text)| format!("    {value}: {}", text.replace('\n', " "))));
    }
    if let Some(default) = either("default") {
        lines.push(format!("  default: {default}"));
    }
    if let Some(properties) = node.get("properties").and_then(Json::as_object) {
        lines.push(format!("  keys: {}", properties.keys().cloned().collect::<Vec<_>>().join(", ")));
    }
    Some(lines.join("\n"))
}

/// The values that a node may have, where they are listed, and what each means.
fn choices<'a>(walk: &Walk<'a>, node: &'a Json) -> Vec<(Json, Option<&'a str>)> {
    if let Some(value) = node.get("const") {
        return vec![(value.clone(), node.get("description").and_then(Json::as_str))];
    }
    // A list, or an optional value, has the choices of what is in it.
    let of_items = node.get("items").map(|items| choices(walk, walk.resolve(items)));
    let listed = node.get("enum").and_then(Json::as_array).into_iter().flatten();
    let listed = listed.map(|value| (value.clone(), None));
    let below = alternatives(node).into_iter().flatten().flat_map(|a| choices(walk, walk.resolve(a)));
    of_items.unwrap_or_default().into_iter().chain(listed).chain(below).collect()
}
