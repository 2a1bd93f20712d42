//! Random vehicle files: each is refused with a message, or flies five seconds as a body.
//!
//! Files are drawn from the schema that the reader itself derives from [`VehicleFile`]: every key within its
//! range (over decades where the range spans them), every choice, every length of list. A file takes each
//! key from the reference vehicle with a probability of its own, from none to nearly all, so that both wild
//! files and slightly odd ones occur. One key against another, the schema cannot say: in three files of four,
//! what is refused is taken from the reference vehicle until the file is accepted; the rest stay as drawn.
//!
//! `HOPBENCH_RANDOM_FILES` sets how many are drawn (`cargo xtask long` asks for 10 000),
//! `HOPBENCH_RANDOM_FIRST` the first number; a file that fails is written to the build folder and named.

// The test reads the tables that a vehicle names, and prints its counts for the record.
#![allow(clippy::disallowed_macros, clippy::disallowed_methods)]

use crate::fixture::files;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use hopbench::input::Document;
use hopbench::plant::column::COLUMNS;
use hopbench::scenario::{Scenario, ScenarioFile, Schedule};
use hopbench::signal::ActuatorCommand;
use hopbench::simulation::Flight;
use hopbench::vehicle::{Vehicle, VehicleFile, VehicleInputs};
use serde_json::Value as Json;
use toml::{Table, Value};

const FLIGHT_S: f64 = 5.0;
const FILES: u64 = 300;
/// Faster than this is no motion of a vehicle but of an unstable integration.
const RUNAWAY_M_S: f64 = 1e5;
const RUNAWAY_RAD_S: f64 = 1e4;
/// Mass that may be unaccounted for, relative.
const MASS_CLOSURE: f64 = 1e-9;

/// SplitMix64 (Steele, Lea and Flood, 2014).
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn chance(&mut self, p: f64) -> bool {
        self.unit() < p
    }

    fn below(&mut self, n: usize) -> usize {
        (self.bits() % n.max(1) as u64) as usize
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
}

/// Draws values that a schema allows.
struct Draw<'a> {
    root: &'a Json,
    random: Random,
    /// Share of the keys that are drawn anew instead of taken from the reference vehicle.
    boldness: f64,
    /// New numbers stay within a factor of about e of the reference vehicle's.
    near: bool,
}

impl<'a> Draw<'a> {
    fn resolve(&self, schema: &'a Json) -> &'a Json {
        let mut schema = schema;
        while let Some(path) = schema.get("$ref").and_then(Json::as_str) {
            schema = self
                .root
                .pointer(path.trim_start_matches('#'))
                .expect("the schema defines what it refers to");
        }
        schema
    }

    /// A value; `None`: the key stays absent.
    fn value(&mut self, outer: &'a Json, known: Option<&Value>) -> Option<Value> {
        let schema = self.resolve(outer);
        let scalar = schema.get("properties").is_none() && schema.get("items").is_none();
        if scalar && known.is_some() && !self.random.chance(self.boldness) {
            return known.cloned();
        }
        if let Some(choices) = schema.get("enum").and_then(Json::as_array) {
            let choice = &choices[self.random.below(choices.len())];
            return choice.as_str().map(|text| Value::String(text.to_owned()));
        }
        if let Some(text) = schema.get("const").and_then(Json::as_str) {
            return Some(Value::String(text.to_owned()));
        }
        for key in ["anyOf", "oneOf"] {
            if let Some(all) = schema.get(key).and_then(Json::as_array) {
                let kind = |s: &Json| s.get("type").and_then(Json::as_str).map(str::to_owned);
                let real: Vec<&Json> = all.iter().filter(|s| kind(s).as_deref() != Some("null")).collect();
                // An optional key that the reference vehicle has not is there now and then.
                if real.len() < all.len() && known.is_none() && !self.random.chance(0.5 * self.boldness) {
                    return None;
                }
                let choice = self.random.below(real.len());
                return self.value(real[choice], known);
            }
        }
        let kind = match schema.get("type") {
            Some(Json::String(kind)) => kind.as_str(),
            Some(Json::Array(kinds)) => {
                if known.is_none() && !self.random.chance(0.5 * self.boldness) {
                    return None;
                }
                kinds.iter().filter_map(Json::as_str).find(|kind| *kind != "null")?
            }
            _ => return known.cloned(),
        };
        match kind {
            "object" => Some(self.table(schema, known)),
            "array" => Some(self.list(schema, known)),
            "boolean" => Some(Value::Boolean(self.random.chance(0.5))),
            "integer" => {
                let (low, high) = self.bounds(outer, schema);
                let x = self.number(low.max(0.0), high.min(1e6), known).round();
                Some(Value::Integer(x.clamp(low, high) as i64))
            }
            "number" => {
                let (low, high) = self.bounds(outer, schema);
                Some(Value::Float(self.number(low, high, known)))
            }
            // Names of files and parts are not drawn.
            "string" => Some(known.cloned().unwrap_or_else(|| Value::String("x".to_owned()))),
            _ => known.cloned(),
        }
    }

    fn bounds(&self, outer: &Json, schema: &Json) -> (f64, f64) {
        let bound = |key: &str| outer.get(key).or_else(|| schema.get(key)).and_then(Json::as_f64);
        (bound("minimum").unwrap_or(-1e6), bound("maximum").unwrap_or(1e6))
    }

    fn number(&mut self, low: f64, high: f64, known: Option<&Value>) -> f64 {
        let number = |v: &Value| v.as_float().or_else(|| v.as_integer().map(|i| i as f64));
        if let Some(x) = known.and_then(number).filter(|x| self.near && *x != 0.0) {
            let factor = libm::exp(self.random.between(-1.0, 1.0));
            return (x * factor).clamp(low, high);
        }
        let dice = self.random.unit();
        if dice < 0.04 {
            return low;
        }
        if dice < 0.08 {
            return high;
        }
        if low <= 0.0 && high >= 0.0 && dice < 0.16 {
            return 0.0;
        }
        if low > 0.0 && high / low > 30.0 {
            return libm::exp(self.random.between(libm::log(low), libm::log(high))).clamp(low, high);
        }
        if low == 0.0 && high > 0.0 && dice < 0.6 {
            return high * libm::pow(10.0, self.random.between(-8.0, 0.0));
        }
        self.random.between(low, high)
    }

    fn table(&mut self, schema: &'a Json, known: Option<&Value>) -> Value {
        let known = known.and_then(Value::as_table);
        let mut table = Table::new();
        let required: Vec<&str> = schema
            .get("required")
            .and_then(Json::as_array)
            .into_iter()
            .flatten()
            .filter_map(Json::as_str)
            .collect();
        for (key, property) in schema.get("properties").and_then(Json::as_object).into_iter().flatten() {
            let known = known.and_then(|table| table.get(key));
            let wanted = known.is_some()
                || required.contains(&key.as_str())
                || self.random.chance(if self.near { 0.1 } else { 0.5 * self.boldness });
            if wanted && let Some(value) = self.value(property, known) {
                table.insert(key.clone(), value);
            }
        }
        if let (Some(inner @ Json::Object(_)), Some(known)) = (schema.get("additionalProperties"), known) {
            for (key, value) in
                known.iter().filter(|(key, _)| schema["properties"].get(key.as_str()).is_none())
            {
                if let Some(value) = self.value(inner, Some(value)) {
                    table.insert(key.clone(), value);
                }
            }
        }
        Value::Table(table)
    }

    fn list(&mut self, schema: &'a Json, known: Option<&Value>) -> Value {
        let known: &[Value] = known.and_then(Value::as_array).map_or(&[], Vec::as_slice);
        let count = |key: &str| schema.get(key).and_then(Json::as_u64).map(|n| n as usize);
        let least = count("minItems").unwrap_or(0);
        let most = count("maxItems").unwrap_or(least.max(known.len()) + 2);
        let mut length = known.len().clamp(least, most);
        if !self.near && self.random.chance(0.3 * self.boldness) {
            length = least + self.random.below(most.min(least.max(known.len()) + 3) + 1 - least);
        }
        let prefix = schema.get("prefixItems").and_then(Json::as_array);
        let mut items = Vec::new();
        for i in 0..length {
            // A longer list repeats the parts that it knows.
            let like = known.get(i).or_else(|| known.get(i % known.len().max(1)));
            let Some(item) = prefix.and_then(|p| p.get(i)).or_else(|| schema.get("items")) else { break };
            items.extend(self.value(item, like));
        }
        Value::Array(items)
    }
}

/// One file by its number, and whether what a reader refuses may be taken from the reference vehicle.
fn draw(schema: &Json, reference: &Value, number: u64) -> (Value, bool) {
    let mut random = Random(number.wrapping_mul(0xd134_2543_de82_ef95));
    random.bits();
    let boldness = [1.0, 0.5, 0.2, 0.1, 0.05, 0.02][random.below(6)];
    let near = random.chance(0.4);
    let tidy = random.chance(0.75);
    let mut draw = Draw { root: schema, random, boldness, near };
    let mut file = draw.value(schema, Some(reference)).expect("a vehicle file is a table");
    if tidy || draw.random.chance(0.8) {
        draw_bodies(&mut file, &mut draw.random);
    }
    (file, tidy)
}

/// Takes a key from the reference vehicle, away if that has none, or the nearest table around it that both
/// files have; `false`: it was the same already, or there is none.
fn take_from_reference(file: &mut Value, reference: &Value, key: &str) -> bool {
    let mut path: Vec<String> =
        key.replace('[', ".").replace(']', "").split('.').map(str::to_owned).collect();
    fn step<'a>(value: &'a Value, part: &str) -> Option<&'a Value> {
        match value {
            Value::Array(items) => items.get(part.parse::<usize>().ok()?),
            _ => value.get(part),
        }
    }
    while !path.is_empty() {
        let known = path.iter().try_fold(reference, |value, part| step(value, part));
        let own = path.iter().try_fold(&*file, |value, part| step(value, part));
        if known.is_none() && own.is_some() {
            restore(file, reference, &path.join("."));
            return true;
        }
        if let (Some(known), Some(own)) = (known, own)
            && known != own
        {
            let known = known.clone();
            let place = path.iter().try_fold(file, |value, part| match value {
                Value::Array(items) => items.get_mut(part.parse::<usize>().ok()?),
                _ => value.get_mut(part.as_str()),
            });
            *place.expect("found a moment ago") = known;
            return true;
        }
        path.pop();
    }
    false
}

/// Paths of the keys in which a file differs from the reference vehicle.
fn differences(file: &Value, reference: &Value, path: &str, found: &mut Vec<String>) {
    match (file, reference) {
        (Value::Table(own), Value::Table(known)) => {
            for (key, value) in own {
                let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
                match known.get(key) {
                    Some(known) => differences(value, known, &path, found),
                    None => found.push(path),
                }
            }
        }
        (Value::Array(own), Value::Array(known)) if own.len() == known.len() => {
            for (i, (own, known)) in own.iter().zip(known).enumerate() {
                differences(own, known, &format!("{path}.{i}"), found);
            }
        }
        _ if file != reference => found.push(path.to_owned()),
        _ => {}
    }
}

/// Puts the reference vehicle's value at a path, or takes the key away where that has none.
fn restore(file: &mut Value, reference: &Value, path: &str) {
    let (parent, key) = path.rsplit_once('.').map_or(("", path), |(parent, key)| (parent, key));
    fn step<'a>(value: &'a Value, part: &str) -> Option<&'a Value> {
        part.parse::<usize>().map_or_else(|_| value.get(part), |i| value.get(i))
    }
    let known = path.split('.').try_fold(reference, step).cloned();
    let place = parent.split('.').filter(|part| !part.is_empty()).try_fold(file, |value, part| {
        match part.parse::<usize>() {
            Ok(i) => value.get_mut(i),
            Err(_) => value.get_mut(part),
        }
    });
    match (place, known) {
        (Some(Value::Table(table)), Some(known)) => drop(table.insert(key.to_owned(), known)),
        (Some(Value::Table(table)), None) => drop(table.remove(key)),
        (Some(Value::Array(list)), known) => {
            let i = key.parse::<usize>().expect("an index");
            match known {
                Some(known) => list[i] = known,
                None => drop(list.remove(i)),
            }
        }
        _ => {}
    }
}

/// The file with every key taken from the reference vehicle that the failure does not need, and the others.
fn reduced(file: &Value, reference: &Value, fails: impl Fn(&Value) -> bool) -> (Value, Vec<String>) {
    let (mut file, mut needed) = (file.clone(), Vec::new());
    differences(&file, reference, "", &mut needed);
    let mut size = needed.len().div_ceil(2);
    while size > 0 {
        let mut from = 0;
        while from < needed.len() {
            let to = (from + size).min(needed.len());
            let mut candidate = file.clone();
            for path in &needed[from..to] {
                restore(&mut candidate, reference, path);
            }
            if fails(&candidate) {
                file = candidate;
                needed.drain(from..to);
            } else {
                from = to;
            }
        }
        size = if size == 1 { 0 } else { size.div_ceil(2) };
    }
    (file, needed)
}

/// Tensors of inertia that a body can have, directions of length one, and a tank at its regulator's pressure:
/// by chance none of them occurs.
fn draw_bodies(file: &mut Value, random: &mut Random) {
    let number = |v: &Value| v.as_float().or_else(|| v.as_integer().map(|i| i as f64)).unwrap_or(0.0);
    // A regulator that holds the tank where it is; another pressure is a choice that few models serve.
    let tank_pa = file["feed"]["tank"]["pressure_pa"].clone();
    if let Some(regulator) = file["pressurant"].get_mut("regulator").filter(|_| random.chance(0.9)) {
        regulator.as_table_mut().unwrap().insert("set_pressure_pa".into(), tank_pa);
    }
    // A tensor of inertia of a box of some size, turned about z.
    for component in file["component"].as_array_mut().into_iter().flatten() {
        let mass = component.get("mass_kg").map_or(1.0, number);
        let mut side = || libm::exp(random.between(libm::log(0.02), libm::log(2.0)));
        let (a, b, c) = (side(), side(), side());
        let box_of = |p: f64, q: f64| mass * (p * p + q * q) / 12.0;
        let (xx, yy, zz) = (box_of(b, c), box_of(a, c), box_of(a, b));
        let (s, k) = libm::sincos(random.between(-3.0, 3.0));
        let (rx, ry, rxy) = (k * k * xx + s * s * yy, s * s * xx + k * k * yy, s * k * (xx - yy));
        let row = |r: [f64; 3]| Value::Array(r.map(Value::Float).to_vec());
        let tensor = vec![row([rx, rxy, 0.0]), row([rxy, ry, 0.0]), row([0.0, 0.0, zz])];
        component.as_table_mut().unwrap().insert("inertia_kg_m2".into(), Value::Array(tensor));
    }
    // Directions are unit vectors.
    let unit = |vector: &mut Value, random: &mut Random| {
        let mut v: Vec<f64> = vector.as_array().map(|v| v.iter().map(number).collect()).unwrap_or_default();
        let norm = v.iter().map(|x| x * x).sum::<f64>().sqrt();
        if norm < 1e-3 {
            v = [0.0; 3].to_vec();
            v[random.below(3)] = 1.0;
        } else {
            v.iter_mut().for_each(|x| *x /= norm);
        }
        *vector = Value::Array(v.into_iter().map(Value::Float).collect());
    };
    for thruster in file["rcs"].get_mut("thruster").and_then(Value::as_array_mut).into_iter().flatten() {
        unit(&mut thruster["force_direction"], random);
    }
    if let Some(direction) = file["sensors"].get_mut("altimeter").and_then(|a| a.get_mut("direction")) {
        unit(direction, random);
    }
}

/// How a file ended.
enum End {
    /// The keys at fault, and a class of message for the count.
    Refused(Vec<String>, String),
    Flown,
    Failed {
        class: &'static str,
        what: String,
    },
}

/// Where and how a vehicle flies; all five seconds long.
fn scenario(random: &mut Random, vehicle: Vehicle) -> Result<(Scenario, usize), String> {
    let pick = random.below(5);
    let mut text = String::from("vehicle = \"v\"\n");
    let scheduled = pick < 3;
    let valve_deg = vehicle.valve_servo.upper_rad.to_degrees().min(90.0);
    let gimbal_deg = vehicle.gimbal.limit_rad.to_degrees().min(30.0);
    if scheduled {
        text += &format!(
            "duration_s = {FLIGHT_S}\n[sensors]\nenabled = false\n[initial]\nengine = \"running\"\n"
        );
        text += if pick == 2 { "clamped = true\n" } else { "place = \"free\"\n" };
        if pick == 1 {
            let mut x = || random.between(-3.0, 3.0);
            let (a, b, c) = (x(), x(), x());
            text +=
                &format!("rate_body_rad_s = [{a}, {b}, {c}]\nvelocity_ned_m_s = [{b}, {c}, {}]\n", 10.0 * a);
        }
        if pick == 2 {
            text += "place = \"pad\"\n";
        }
        if random.chance(0.3) {
            text += &format!("[model]\nchamber = \"{}\"\n", ["quasi_steady", "filling"][random.below(2)]);
        }
    } else if pick == 3 {
        // The built-in autopilot does not wait for a person.
        text += "[mission]\nalignment_s = 1\nready_s = 0\n";
    }
    if random.chance(0.3) {
        text += &format!("[wind]\nmean_speed_m_s = {}\n", random.between(0.0, 15.0));
    }
    let schedule = scheduled.then(|| {
        let mut rows = String::from("time_s,valve_deg,gimbal_x_deg,gimbal_y_deg,rcs_roll\n");
        let mut time_s = 0.0;
        while time_s < FLIGHT_S {
            let mut share = |zero: f64| if random.chance(zero) { 0.0 } else { random.between(-1.0, 1.0) };
            let (v, x, y, r) = (share(0.1).abs(), share(0.3), share(0.3), share(0.3));
            rows += &format!("{time_s},{},{},{},{r}\n", v * valve_deg, x * gimbal_deg, y * gimbal_deg);
            time_s += random.between(0.05, 1.0);
        }
        rows
    });
    let document = Document::parse("scenario", &text).map_err(|e| format!("scenario: {e}"))?;
    let file = ScenarioFile::read(&document).map_err(|e| format!("scenario: {e}"))?;
    let schedule = match schedule {
        Some(rows) => Some(Schedule::parse(&rows).map_err(|e| format!("schedule: {e}"))?),
        None => None,
    };
    let scenario =
        Scenario::new("random", file, vehicle, schedule).map_err(|faults| faults[0].to_string())?;
    Ok((scenario, pick))
}

fn refusal(keys: Vec<String>, message: &str) -> End {
    assert!(!message.trim().is_empty(), "a refusal says why");
    // Numbers out, so that like refusals are counted together.
    let words: String = message.chars().map(|c| if c.is_ascii_digit() { '#' } else { c }).collect();
    End::Refused(keys, words.lines().next().unwrap_or_default().chars().take(70).collect())
}

fn flown(text: &str, number: u64, tables: (&str, &str)) -> End {
    let document = match Document::parse("random.toml", text) {
        Ok(document) => document,
        Err(e) => return End::Failed { class: "the file is no TOML", what: e.to_string() },
    };
    let (map, area) = tables;
    let read = |file: &Path| match file.file_name().and_then(|name| name.to_str()) {
        Some("cea_reference_fit.csv") => Ok(map.to_owned()),
        Some("valve_area_vs_angle.csv") => Ok(area.to_owned()),
        _ => Err("no such file"),
    };
    let vehicle = VehicleInputs::read(document, Path::new("random.toml"), read);
    let vehicle = match vehicle.and_then(|inputs| inputs.vehicle()) {
        Ok(vehicle) => vehicle,
        Err(e) => {
            let keys = e.diagnostics.iter().map(|fault| fault.key.clone()).collect();
            return refusal(keys, &e.diagnostics[0].message);
        }
    };
    let random = &mut Random(number ^ 0x5eed);
    let (scenario, place) = match scenario(random, vehicle) {
        Ok(scenario) => scenario,
        Err(message) => return refusal(Vec::new(), &format!("scenario: {message}")),
    };
    let mut flight = match Flight::new(&scenario, number as u32) {
        Ok(flight) => flight,
        Err(fault) => return refusal(vec![fault.key.clone()], &fault.to_string()),
    };
    let mut held = ActuatorCommand::SAFE;
    let mut until = 0;
    let mut before = *flight.snapshot();
    let start_kg = before.mass_kg + before.chamber_gas_kg + before.manifold_kg;
    for step in 0..(FLIGHT_S / flight.step_s()).round() as u32 {
        let command = if let Some(schedule) = &scenario.schedule {
            *schedule.at(flight.snapshot().time)
        } else if place == 3 {
            held = flight.autopilot_command().unwrap_or(held);
            held
        } else {
            if step == until {
                let mut share = || random.between(-1.0, 1.0);
                held.gimbal_x_rad = 0.2 * share();
                held.gimbal_y_rad = 0.2 * share();
                held.rcs_roll = share();
                let throttle = share().abs();
                held.throttle = if share() > 0.0 {
                    hopbench::signal::Throttle::ThrustN(
                        throttle * scenario.vehicle.rating.thrust_command_max_n,
                    )
                } else {
                    hopbench::signal::Throttle::ValveRad(throttle * scenario.vehicle.valve_servo.upper_rad)
                };
                held.armed = step < 500 || share() > -0.8;
                held.discrete = hopbench::signal::Discrete::FLIGHT;
                until = step + 50 + random.below(800) as u32;
            }
            held
        };
        flight.step(&command);
        let now = *flight.snapshot();
        if now.velocity_ned_m_s.norm() > RUNAWAY_M_S || now.rate_body_rad_s.norm() > RUNAWAY_RAD_S {
            let what = format!("{} m/s, {} rad/s", now.velocity_ned_m_s.norm(), now.rate_body_rad_s.norm());
            return End::Failed {
                class: "runaway",
                what: format!("{what} at {:.3} s, place {}", now.time.s(), place),
            };
        }
        if let Some((class, what)) = fault(&before, &now, start_kg) {
            return End::Failed { class, what: format!("{what} at {:.3} s, place {place}", now.time.s()) };
        }
        before = now;
        // Crashed, tipped over, aborted: the flight is over.
        if flight.outcome().is_some() {
            break;
        }
    }
    End::Flown
}

/// What a flight must never show.
fn fault(
    before: &hopbench::plant::Snapshot,
    now: &hopbench::plant::Snapshot,
    start_kg: f64,
) -> Option<(&'static str, String)> {
    if let Some(column) = COLUMNS.iter().find(|column| !column.of(now).is_finite()) {
        return Some(("not finite", column.name.to_owned()));
    }
    if now.singular {
        return Some(("no balance of momentum", String::new()));
    }
    let masses = [
        ("mass", now.mass_kg),
        ("nitrous oxide", now.nitrous_kg),
        ("fuel", now.fuel_kg),
        ("bottle", now.nitrogen_bottle_kg),
        ("ullage", now.nitrogen_ullage_kg),
        ("chamber gas", now.chamber_gas_kg),
    ];
    if let Some((name, kg)) = masses.into_iter().find(|(_, kg)| *kg < 0.0) {
        return Some(("negative mass", format!("{name}: {kg} kg")));
    }
    if now.inertia_kg_m2.cholesky().is_none() {
        return Some(("inertia not positive definite", format!("{}", now.inertia_kg_m2)));
    }
    if now.fuel_kg > before.fuel_kg {
        return Some(("fuel grows", format!("by {} kg", now.fuel_kg - before.fuel_kg)));
    }
    let gone: f64 = now.expelled_kg.iter().sum();
    let open = (now.mass_kg + now.chamber_gas_kg + now.manifold_kg + gone) / start_kg - 1.0;
    if open.abs() > MASS_CLOSURE {
        return Some(("mass not closed", format!("{open:e}")));
    }
    if now.thrust_n < 0.0 {
        return Some(("negative thrust", format!("{} N", now.thrust_n)));
    }
    None
}

fn setting(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().map_or(default, |text| text.parse().unwrap_or_else(|e| panic!("{name}: {e}")))
}

#[test]
fn every_random_vehicle_is_refused_with_a_message_or_flies_as_a_body() {
    let schema = schemars::schema_for!(VehicleFile);
    let folder = files::folder().join("vehicles");
    let reference: Value = Value::Table(
        toml::from_str(&files::text(&folder.join("reference.toml"))).expect("the reference file"),
    );
    let map = files::text(&folder.join("cea_reference_fit.csv"));
    let area = files::text(&folder.join("valve_area_vs_angle.csv"));

    let (first, count) = (setting("HOPBENCH_RANDOM_FIRST", 0), setting("HOPBENCH_RANDOM_FILES", FILES));
    let next = AtomicU64::new(first);
    let found: Mutex<(u64, BTreeMap<String, u64>, Vec<String>)> = Mutex::default();
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    if number >= first + count {
                        break;
                    }
                    let (mut file, tidy) = draw(schema.as_value(), &reference, number);
                    let tried = |text: &str| {
                        catch_unwind(AssertUnwindSafe(|| flown(text, number, (&map, &area)))).unwrap_or_else(
                            |panic| {
                                let what = panic.downcast_ref::<String>().cloned();
                                let what =
                                    what.or_else(|| panic.downcast_ref::<&str>().map(|s| (*s).to_owned()));
                                End::Failed { class: "panic", what: what.unwrap_or_default() }
                            },
                        )
                    };
                    let (text, end) = loop {
                        let text = toml::to_string(&file).expect("a table is TOML");
                        let end = tried(&text);
                        match &end {
                            End::Refused(keys, _)
                                if tidy
                                    && keys
                                        .iter()
                                        .filter(|key| take_from_reference(&mut file, &reference, key))
                                        .count()
                                        > 0 => {}
                            _ => break (text, end),
                        }
                    };
                    let mut counts = found.lock().expect("no thread panics with the lock");
                    match end {
                        End::Flown => counts.0 += 1,
                        End::Refused(keys, class) => {
                            let key = keys.first().map_or("", String::as_str);
                            *counts.1.entry(format!("{key}: {class}")).or_default() += 1
                        }
                        End::Failed { class, what } => {
                            drop(counts);
                            let (file, keys) = reduced(&file, &reference, |file| {
                                let text = toml::to_string(file).expect("a table is TOML");
                                matches!(tried(&text), End::Failed { class: again, .. } if again == class)
                            });
                            let value = |key: &String| {
                                let own = key.split('.').try_fold(&file, |value, part| {
                                    part.parse::<usize>().map_or_else(|_| value.get(part), |i| value.get(i))
                                });
                                format!("{key} = {}", own.map_or(String::new(), ToString::to_string))
                            };
                            let keys: Vec<String> = keys.iter().map(value).collect();
                            let path = std::path::Path::new(env!("CARGO_TARGET_TMPDIR"))
                                .join(format!("random_vehicle_{number}.toml"));
                            std::fs::write(&path, &text).expect("the build folder takes files");
                            let line = format!(
                                "{class}: {what}: file {number}, {}; needs {}",
                                path.display(),
                                keys.join("; ")
                            );
                            println!("  failed {line}");
                            found.lock().expect("no thread panics with the lock").2.push(line);
                        }
                    }
                }
            });
        }
    });
    let (flown, refused, mut failed) = found.into_inner().expect("no thread panics with the lock");
    failed.sort();
    let refused_count: u64 = refused.values().sum();
    println!("{count} files from {first}: {flown} flown, {refused_count} refused, {} failed", failed.len());
    let mut classes: Vec<_> = refused.into_iter().collect();
    classes.sort_by_key(|(_, n)| std::cmp::Reverse(*n));
    for (class, n) in classes.iter().take(25) {
        println!("  {n:5} {class}");
    }
    assert!(failed.is_empty(), "{} of {count} files failed; the first: {}", failed.len(), failed[0]);
    // A test in which nothing flies, or nothing is refused, shows nothing.
    assert!(flown * 5 >= count && refused_count * 20 >= count, "{flown} flown, {refused_count} refused");
}

/// Numbers below a schema without a least and a greatest value, by their keys.
fn unbounded(root: &Json, schema: &Json, path: &str, found: &mut Vec<String>) {
    match schema {
        Json::Object(keys) => {
            let bounded = keys.contains_key("minimum") && keys.contains_key("maximum");
            let kinds = keys.get("type").map_or(String::new(), Json::to_string);
            if (kinds.contains("number") || kinds.contains("integer")) && !bounded {
                found.push(path.to_owned());
            }
            if let Some(target) = keys.get("$ref").and_then(Json::as_str).filter(|_| !bounded) {
                let target = root.pointer(target.trim_start_matches('#')).expect("the schema defines it");
                unbounded(root, target, path, found);
            }
            for (key, value) in keys {
                match key.as_str() {
                    "properties" => {
                        for (key, value) in value.as_object().into_iter().flatten() {
                            unbounded(root, value, &format!("{path}.{key}"), found);
                        }
                    }
                    "items" | "prefixItems" | "anyOf" | "oneOf" | "allOf" | "additionalProperties" => {
                        unbounded(root, value, path, found);
                    }
                    _ => {}
                }
            }
        }
        Json::Array(items) => items.iter().for_each(|item| unbounded(root, item, path, found)),
        _ => {}
    }
}

#[test]
fn every_number_of_a_vehicle_file_has_a_range() {
    let schema = schemars::schema_for!(VehicleFile);
    let mut found = Vec::new();
    unbounded(schema.as_value(), schema.as_value(), "", &mut found);
    // Which inertia a body can have, no range can tell.
    assert_eq!(found, [".component.inertia_kg_m2"]);
}
