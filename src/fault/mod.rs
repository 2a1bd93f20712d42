//! What breaks, how and when: faults of sensors, plant, actuators, wire and flight controller.
//!
//! A scenario lists its faults as `[[fault]]`; more may be injected while it flies. Each names a component
//! and a mode of the [`catalogue()`], which says what its value means, and at most one trigger: mission time,
//! height or an event. [`Faults`] moves them on between steps. What acts becomes plain values for whoever
//! they break: [`PlantEffect`] for the plant, [`WireEffect`] for the bench; sensor faults act on the finished
//! [`Measurement`]. Two faults of one kind add up: errors and times as sums, shares as shares of what is
//! left.

mod catalogue;
pub mod plant;
mod sensor;
mod trigger;
pub mod wire;

pub use catalogue::{Component, Mode, Quantity, Row, catalogue, explain, row};
pub use plant::PlantEffect;
pub use trigger::Circumstances;
pub use wire::WireEffect;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::event::EventKind;
use crate::input::Invalid;
use crate::noise::stream;
use crate::signal::Measurement;
use crate::time::SimTime;

use sensor::{Memory, Scene};
use trigger::Waiting;

/// An entry `[[fault]]` of a scenario.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Fault {
    /// Name in the list of events, `fault:NAME` and `fault_over:NAME`; its random numbers follow from the seed and this name. Absent: `COMPONENT_MODE`.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub name: String,
    /// What breaks.
    pub component: Component,
    /// How.
    pub mode: Mode,
    /// How much; unit, range and default follow from component and mode.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<f64>,
    /// Along one axis: body FRD x, y, z, or north, east, down of a position; absent: along each of the three.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axis: Option<Axis>,
    /// Begins at this mission time, that is since ignition (s). Without this and the other three triggers: at step 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub at_s: Option<f64>,
    /// Begins when the pivot first rises above this height over its rest height (m).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub above_m: Option<f64>,
    /// Begins when the pivot, after having been above it, first falls below this height over its rest height (m).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub below_m: Option<f64>,
    /// Begins at the first event of this name, as `armed`, `ignition`, `liftoff`, `phase:hover`; `docs/events.md` lists them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<String>")]
    pub at_event: Option<EventKind>,
    /// Begins so much later than its trigger (s).
    #[serde(default, skip_serializing_if = "is_zero")]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub after_s: f64,
    /// How long it lasts (s); absent: to the end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub duration_s: Option<f64>,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// One of three axes: body FRD, or north, east, down of a position.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Axis {
    /// Body x, or north.
    X,
    /// Body y, or east.
    Y,
    /// Body z, or down.
    Z,
}

impl Fault {
    /// One that acts from step 0, or from its injection, to the end, with the default value.
    pub fn new(component: Component, mode: Mode) -> Self {
        Self {
            name: String::new(),
            component,
            mode,
            value: None,
            axis: None,
            at_s: None,
            above_m: None,
            below_m: None,
            at_event: None,
            after_s: 0.0,
            duration_s: None,
        }
    }

    /// Its name, or the one that follows from component and mode.
    pub fn name(&self) -> String {
        if self.name.is_empty() {
            format!("{}_{}", self.component.name(), self.mode.name())
        } else {
            self.name.clone()
        }
    }

    /// # Errors
    /// When the component cannot break so, the value is out of range, or there are two triggers.
    pub fn validate(&self) -> Result<(), Invalid> {
        let (component, mode) = (self.component.name(), self.mode.name());
        let Some(row) = row(self.component, self.mode) else {
            let modes: Vec<_> = catalogue()
                .filter(|row| row.component == self.component)
                .map(|row| row.mode.name())
                .collect();
            return Err(Invalid::new(
                "mode",
                format!("{component} has no fault {mode}; allowed {}", modes.join(", ")),
            ));
        };
        match (row.value, self.value) {
            (None, Some(value)) => {
                return Err(Invalid::new(
                    "value",
                    format!("{value} means nothing for {component} {mode}: leave it out"),
                ));
            }
            (Some(quantity), Some(value)) if !(quantity.least..=quantity.greatest).contains(&value) => {
                return Err(Invalid::new(
                    "value",
                    format!(
                        "{value} is out of range for {component} {mode}; allowed {} to {} ({})",
                        quantity.least, quantity.greatest, quantity.unit
                    ),
                ));
            }
            _ => {}
        }
        if self.axis.is_some() && !row.axes {
            return Err(Invalid::new("axis", format!("{component} {mode} has no axes: leave it out")));
        }
        let triggers = [
            ("at_s", self.at_s.is_some()),
            ("above_m", self.above_m.is_some()),
            ("below_m", self.below_m.is_some()),
            ("at_event", self.at_event.is_some()),
        ];
        let mut given = triggers.iter().filter(|(_, given)| *given).map(|(key, _)| *key);
        if let (Some(first), Some(second)) = (given.next(), given.next()) {
            return Err(Invalid::new(
                second,
                format!("a second trigger beside {first}: an entry has one at most"),
            ));
        }
        if self.duration_s == Some(0.0) {
            return Err(Invalid::new(
                "duration_s",
                "0 breaks nothing: give it a time, or none for all of the flight",
            ));
        }
        Ok(())
    }

    /// What it does while it acts.
    fn acting(&self, since: SimTime) -> Acting {
        let default = row(self.component, self.mode).and_then(|row| row.value).map_or(0.0, |q| q.default);
        Acting {
            component: self.component,
            mode: self.mode,
            value: self.value.unwrap_or(default),
            axis: self.axis,
            since,
        }
    }

    /// For people: component, mode, value and unit, axis.
    pub(crate) fn describe(&self) -> String {
        let mut text = format!("{} {}", self.component.name(), self.mode.name());
        if let Some(quantity) = row(self.component, self.mode).and_then(|row| row.value) {
            text += &format!(" {} ({})", self.value.unwrap_or(quantity.default), quantity.unit);
        }
        if let Some(axis) = self.axis {
            text += &format!(", axis {}", ["x", "y", "z"][axis as usize]);
        }
        text
    }
}

/// Checks the entries of a scenario, each and beside each other.
///
/// # Errors
/// When one cannot be, two have one name, or one waits for a fault that is not there.
pub fn validate(entries: &[Fault]) -> Result<(), Invalid> {
    for (index, entry) in entries.iter().enumerate() {
        entry.validate().map_err(|invalid| invalid.within(&index.to_string()))?;
        let name = entry.name();
        if let Some(first) = (0..index).find(|&first| entries[first].name() == name) {
            return Err(Invalid::new(
                format!("{index}.name"),
                format!("entry {first} is named {name:?} too: each needs its own name"),
            ));
        }
        if let Some(event @ (EventKind::Fault(awaited) | EventKind::FaultOver(awaited))) = &entry.at_event {
            let others = entries.iter().enumerate().filter(|(other, _)| *other != index);
            let names: Vec<_> = others.map(|(_, other)| other.name()).collect();
            if !names.contains(awaited) {
                return Err(Invalid::new(
                    format!("{index}.at_event"),
                    if names.is_empty() {
                        format!("\"{event}\" never happens: there is no other entry")
                    } else {
                        format!("\"{event}\" never happens; other entries: {}", names.join(", "))
                    },
                ));
            }
        }
    }
    Ok(())
}

/// A fault that acts now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Acting {
    /// In what.
    pub component: Component,
    /// How.
    pub mode: Mode,
    /// How much, in the unit of its row; 0 where there is none.
    pub value: f64,
    /// Along which axis; `None`: along each.
    pub axis: Option<Axis>,
    /// Run time at which it began.
    pub since: SimTime,
}

/// What acts now, for whoever is broken by it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Effects {
    /// On the plant.
    pub plant: PlantEffect,
    /// On the wire and the flight controller.
    pub wire: WireEffect,
}

/// The faults of a flight, in time.
#[derive(Clone, Debug)]
pub struct Faults {
    running: Vec<Running>,
    effects: Effects,
    seed: u64,
    scene: Scene,
}

#[derive(Clone, Debug)]
struct Running {
    fault: Fault,
    stage: Stage,
    memory: Memory,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    /// For its trigger.
    Waiting(Waiting),
    /// Triggered; begins at this run time.
    Pending(SimTime),
    Acting(Acting),
    Over,
}

impl Faults {
    /// From the entries of a scenario and the seed of the run.
    pub fn new(entries: &[Fault], seed: u64) -> Self {
        let mut faults =
            Self { running: Vec::new(), effects: Effects::default(), seed, scene: Scene::default() };
        for fault in entries {
            let running = faults.running(fault, Stage::Waiting(Waiting::default()));
            faults.running.push(running);
        }
        faults
    }

    fn running(&self, fault: &Fault, stage: Stage) -> Running {
        let stream = stream(self.seed, &format!("fault.{}", fault.name()));
        Running { fault: fault.clone(), stage, memory: Memory::new(stream) }
    }

    /// An event happened, for entries that wait for it.
    pub fn hear(&mut self, event: &EventKind) {
        for running in &mut self.running {
            if let Stage::Waiting(waiting) = &mut running.stage {
                waiting.hear(&running.fault, event);
            }
        }
    }

    /// Moves on to the circumstances at the begin of a step. `changed` hears of every fault that begins (`true`) or ends.
    pub fn advance(&mut self, now: &Circumstances, mut changed: impl FnMut(&Fault, bool)) {
        if self.running.is_empty() {
            return;
        }
        self.scene = Scene { height_m: now.height_m, lit: now.lit, thrust_n: now.thrust_n };
        let mut any = false;
        for running in &mut self.running {
            let fault = &running.fault;
            if let Stage::Waiting(waiting) = &mut running.stage
                && waiting.triggered(fault, now)
            {
                running.stage = Stage::Pending(now.time + SimTime::from_s(fault.after_s));
            }
            match running.stage {
                Stage::Pending(begin) if now.time >= begin => {
                    running.stage = Stage::Acting(fault.acting(now.time));
                    changed(fault, true);
                    any = true;
                }
                Stage::Acting(Acting { since, .. })
                    if fault
                        .duration_s
                        .is_some_and(|duration_s| now.time >= since + SimTime::from_s(duration_s)) =>
                {
                    running.stage = Stage::Over;
                    changed(fault, false);
                    any = true;
                }
                _ => {}
            }
        }
        if any {
            self.sum();
        }
    }

    /// From `time` on `fault` acts, without regard to a trigger; one of the same component and mode that acts is replaced.
    ///
    /// # Errors
    /// As [`Fault::validate`].
    pub fn inject(&mut self, fault: &Fault, time: SimTime) -> Result<(), Invalid> {
        fault.validate()?;
        let injected = self.running(fault, Stage::Acting(fault.acting(time)));
        self.end(fault.component, Some(fault.mode), |_| {});
        // What is over is forgotten, so that a long run of injections stays small.
        self.running.retain(|running| running.stage != Stage::Over);
        self.running.push(injected);
        self.sum();
        Ok(())
    }

    /// Ends what acts in a component, of one mode or of any. `ended` hears of each.
    pub fn clear(&mut self, component: Component, mode: Option<Mode>, ended: impl FnMut(&Fault)) {
        self.end(component, mode, ended);
        self.sum();
    }

    fn end(&mut self, component: Component, mode: Option<Mode>, mut ended: impl FnMut(&Fault)) {
        for running in &mut self.running {
            let hit = matches!(running.stage, Stage::Acting(Acting { component: c, mode: m, .. })
                if c == component && mode.is_none_or(|mode| mode == m));
            if hit {
                running.stage = Stage::Over;
                ended(&running.fault);
            }
        }
    }

    /// What acts now.
    pub(crate) fn acting(&self) -> impl Iterator<Item = &Acting> {
        self.running.iter().filter_map(|running| match &running.stage {
            Stage::Acting(acting) => Some(acting),
            _ => None,
        })
    }

    /// Entries that have not begun.
    pub fn idle(&self) -> impl Iterator<Item = &Fault> {
        let idle = |running: &&Running| matches!(running.stage, Stage::Waiting(_) | Stage::Pending(_));
        self.running.iter().filter(idle).map(|running| &running.fault)
    }

    /// What acts now, summed.
    pub fn effects(&self) -> &Effects {
        &self.effects
    }

    /// What becomes of a measurement.
    pub(crate) fn spoil(&mut self, measurement: &mut Measurement) {
        let mut acting = self
            .running
            .iter_mut()
            .filter_map(|running| match &running.stage {
                Stage::Acting(acting) if acting.component.is_sensor() => Some((acting, &mut running.memory)),
                _ => None,
            })
            .peekable();
        if acting.peek().is_some() {
            sensor::spoil(acting, &self.scene, measurement);
        }
    }

    fn sum(&mut self) {
        let mut effects = Effects::default();
        for acting in self.acting() {
            effects.plant.add(acting);
            effects.wire.add(acting);
        }
        self.effects = effects;
    }
}
