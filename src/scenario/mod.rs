//! A flight as data: which vehicle, where it starts, what is asked of it and what is expected.

mod campaign;
mod dispersion;
mod load;
mod schedule;

pub use campaign::{CampaignFile, Success, Variant};
pub use dispersion::{Dispersion, Distribution, Mode};
pub use load::{FileKind, ScenarioInputs};
pub use schedule::{Schedule, ScheduleError};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::autopilot::Mission;
use crate::disturbance::{self, Disturbance};
use crate::dynamics::slosh::SloshModel;
use crate::environment::Site;
use crate::environment::wind::WindParameters;
use crate::fault;
use crate::input::{Diagnostic, Document, InputError, Invalid};
use crate::signal::ActuatorCommand;
use crate::vehicle::Vehicle;

/// A scenario file. Relative paths in it start at its own folder.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScenarioFile {
    /// One line for people.
    #[serde(default)]
    pub description: String,
    /// Vehicle file.
    pub vehicle: String,
    /// Values that replace those of the vehicle file: its dotted keys, quoted, as in `"feed.tank.length_m" = 0.4`. `--set` comes after them.
    #[serde(default)]
    pub vehicle_set: std::collections::BTreeMap<String, serde_json::Value>,
    /// Seed of every random stream; `--seed` replaces it.
    #[serde(default)]
    #[schemars(range(min = 0))]
    pub seed: u32,
    /// End of an open-loop run (s); absent: the flight ends by itself.
    #[schemars(range(min = 0.001, max = 86400.0))]
    pub duration_s: Option<f64>,
    /// Longest mission time, counted from ignition (s).
    #[serde(default = "default_timeout_s")]
    #[schemars(range(min = 1.0, max = 86400.0))]
    pub timeout_s: f64,
    /// Longest wait on the pad for arming [s of simulated time since the first frame of the flight controller]; 0: no limit.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub arm_wait_s: f64,
    /// Silence of the flight controller that counts as its loss (ms).
    #[serde(default = "default_fc_timeout_ms")]
    #[schemars(range(min = 10.0, max = 60000.0))]
    pub fc_timeout_ms: f64,
    /// What happens when the flight controller is lost in flight.
    #[serde(default)]
    pub on_fc_loss: OnFcLoss,
    /// The scenario means to lose its flight controller, so the fallback's flight may pass.
    #[serde(default)]
    pub fallback_expected: bool,
    /// Open-loop command schedule, a CSV file; `fly --commands` replaces it.
    pub commands: Option<String>,
    /// Replaces the vehicle file's site.
    pub site: Option<Site>,
    /// Wind; absent: calm.
    #[serde(default)]
    pub wind: WindParameters,
    /// What no model of the vehicle accounts for.
    #[serde(default)]
    pub disturbance: Vec<Disturbance>,
    /// What breaks, how and when.
    #[serde(default)]
    pub fault: Vec<fault::Fault>,
    /// State at step 0.
    #[serde(default)]
    pub initial: Initial,
    /// Who commands igniter, isolation, vent and hold-down.
    #[serde(default)]
    pub sequence: Sequence,
    /// Idealised actuators.
    #[serde(default)]
    pub actuators: Actuators,
    /// Choices of model that replace those of the vehicle file.
    #[serde(default)]
    pub model: Model,
    /// Full physics, or the seed paper's scheme.
    #[serde(default)]
    pub fidelity: Fidelity,
    /// What is held still, and how the plant integrates.
    #[serde(default)]
    pub physics: Physics,
    /// Sensors as a whole.
    #[serde(default)]
    pub sensors: Sensors,
    /// What the built-in autopilot is to fly.
    #[serde(default)]
    pub mission: Mission,
    /// What the flight must show to pass.
    #[serde(default)]
    pub expect: Expect,
}

fn default_timeout_s() -> f64 {
    120.0
}

fn default_fc_timeout_ms() -> f64 {
    200.0
}

/// What the bench does when the flight controller falls silent in flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OnFcLoss {
    /// The built-in autopilot, which has shadowed the measurements, flies on.
    #[default]
    Autopilot,
    /// The engine is cut.
    Cut,
}

/// State at step 0.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Initial {
    /// Standing on its legs, or free.
    #[serde(default)]
    pub place: Place,
    /// Gimbal pivot, north-east-down from the pad surface (m). On the pad the height follows from the legs.
    #[serde(default)]
    #[schemars(inner(range(min = -10000.0, max = 10000.0)))]
    pub position_ned_m: [f64; 3],
    /// Velocity of the pivot (m/s).
    #[serde(default)]
    #[schemars(inner(range(min = -200.0, max = 200.0)))]
    pub velocity_ned_m_s: [f64; 3],
    /// Attitude, scalar first; normalised when read.
    #[serde(default = "identity")]
    #[schemars(inner(range(min = -1.0, max = 1.0)))]
    pub q_ned_from_body: [f64; 4],
    /// Body rate (rad/s).
    #[serde(default)]
    #[schemars(inner(range(min = -20.0, max = 20.0)))]
    pub rate_body_rad_s: [f64; 3],
    /// Liquid nitrous oxide (kg); absent: the vehicle file's fill.
    #[schemars(range(min = 0.0, max = 500.0))]
    pub nitrous_kg: Option<f64>,
    /// Nitrogen, bottle and run tank together (kg); absent: the vehicle file's bottle pressure.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub nitrogen_kg: Option<f64>,
    /// Port radius (m); absent: the vehicle file's.
    #[schemars(range(min = 0.001, max = 0.5))]
    pub port_radius_m: Option<f64>,
    /// Throat radius (m); absent: the vehicle file's.
    #[schemars(range(min = 0.001, max = 0.2))]
    pub throat_radius_m: Option<f64>,
    /// Engine off, or lit and steady at the first command.
    #[serde(default)]
    pub engine: EngineStart,
    /// Held fast in position and attitude, as on a static stand.
    #[serde(default)]
    pub clamped: bool,
}

impl Default for Initial {
    fn default() -> Self {
        Self {
            place: Place::Pad,
            position_ned_m: [0.0; 3],
            velocity_ned_m_s: [0.0; 3],
            q_ned_from_body: identity(),
            rate_body_rad_s: [0.0; 3],
            nitrous_kg: None,
            nitrogen_kg: None,
            port_radius_m: None,
            throat_radius_m: None,
            engine: EngineStart::Off,
            clamped: false,
        }
    }
}

fn identity() -> [f64; 4] {
    [1.0, 0.0, 0.0, 0.0]
}

/// Where a flight starts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Place {
    /// At rest on its legs.
    #[default]
    Pad,
    /// Anywhere, with nothing to stand on: no ground in the whole run.
    Free,
}

/// Engine at step 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum EngineStart {
    /// Cold.
    #[default]
    Off,
    /// Lit, at its steady state for the first command.
    Running,
}

/// `[sequence]`.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sequence {
    /// Who commands the discrete actuators.
    pub source: SequenceSource,
}

/// Who commands igniter, isolation, vent and hold-down.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SequenceSource {
    /// Arming opens the isolation valve and shuts the vent; throttle above the shutdown fraction fires the igniter and releases the hold-down; disarming safes all.
    #[default]
    Auto,
    /// The flight controller's own channels.
    Controls,
}

/// `[actuators]`.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Actuators {
    /// Valve angle, gimbal angles and RCS thrust equal the command at once.
    #[serde(default)]
    pub ideal: bool,
    /// With `ideal`: brings back the gimbal servos alone.
    pub gimbal: Option<GimbalActuator>,
}

/// The gimbal beside otherwise ideal actuators.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GimbalActuator {
    /// Second-order servo with delay, as in the vehicle file.
    Servo,
    /// The angle equals the command.
    Ideal,
}

/// `[model]`.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Model {
    /// Replaces `engine.chamber.model`.
    pub chamber: Option<crate::propulsion::ChamberModel>,
    /// Replaces `gimbal.engine_inertia`.
    pub gimbal_inertia: Option<bool>,
}

/// Which physics the plant runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Fidelity {
    /// Everything the vehicle file says.
    #[default]
    Full,
    /// The seed paper's scheme: explicit Euler at `paper_mode.step_s`, flow sweep, Isp and c* of O/F alone, one-way slosh, rigid body without jet damping, moving centre of mass or engine inertia. Actuators stay as they are. It does not see what the file says of slosh.model, slosh.second_mode, slosh.hardening_law, slosh.baffle_damping_ratio, feed.tank.ullage, feed.line, feed.manifold, single_phase of valve and injector, engine.chamber.model, engine.depletion.model, engine.grain.fuel_flow_lag_s, nozzle separation, pressurant.bottle.model, droop and lock-up of the regulator, gimbal.engine_inertia and the scenario's `model` table; physics.step_s and physics.integrator are refused beside it.
    Paper,
}

/// `[physics]`: for studies.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Physics {
    /// Couplings held at their values at step 0; mass goes on falling whatever is held.
    pub freeze: Vec<Coupling>,
    /// Step of the plant (s), in whole microseconds; another than 0.001 only in `fly` with a command schedule and sensors.enabled = false.
    #[schemars(range(min = 1e-5, max = 0.05))]
    pub step_s: f64,
    /// How a step is made.
    pub integrator: IntegratorKind,
}

impl Default for Physics {
    fn default() -> Self {
        Self { freeze: Vec::new(), step_s: PLANT_STEP_S, integrator: IntegratorKind::default() }
    }
}

/// The plant's own step (s).
const PLANT_STEP_S: f64 = 0.001;

/// A coupling that can be held still.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Coupling {
    /// The centre of mass stays where it is in the body; mass and inertia about it go on changing.
    Com,
    /// The inertia about the centre of mass stays, although mass falls and the centre moves.
    Inertia,
    /// Internal ballistics (fuel flow, chamber volume) see the initial port radius; fuel mass, and with it the grain's share of centre and inertia, goes on falling.
    Port,
    /// No nitrogen moves from bottle to run tank: the gas above the liquid keeps its mass, thrusters draw from the bottle. Pressures are those of the real distribution.
    Nitrogen,
    /// The liquid is a solid column.
    Slosh,
    /// The throat does not wear.
    Throat,
}

/// How a step is made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum IntegratorKind {
    /// Runge and Kutta's of fourth order.
    #[default]
    Rk4,
    /// Explicit Euler, to see what it costs.
    Euler,
}

/// `[sensors]` of a scenario.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sensors {
    /// Without sensors nothing but a schedule can fly.
    #[serde(default = "yes")]
    pub enabled: bool,
    /// Replaces the grade of the vehicle file's receiver.
    pub gnss: Option<crate::sensor::GnssGrade>,
    /// Replaces the receiver's delay, whatever the profile says (s).
    #[schemars(range(min = 0.0, max = 1.0))]
    pub gnss_delay_s: Option<f64>,
}

impl Default for Sensors {
    fn default() -> Self {
        Self { enabled: true, gnss: None, gnss_delay_s: None }
    }
}

fn yes() -> bool {
    true
}

/// `[expect]`: what a flight must show. A key that is absent is not judged.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Expect {
    /// How the flight must end.
    pub outcome: Option<Outcome>,
    /// Vertical speed of the centre of mass at first contact, at most (m/s).
    #[schemars(range(min = 0.0, max = 100.0))]
    pub touchdown_vertical_speed_max_m_s: Option<f64>,
    /// Horizontal speed of the centre of mass at first contact, at most (m/s).
    #[schemars(range(min = 0.0, max = 100.0))]
    pub touchdown_lateral_speed_max_m_s: Option<f64>,
    /// Tilt at first contact, at most (deg).
    #[schemars(range(min = 0.0, max = 180.0))]
    pub touchdown_tilt_max_deg: Option<f64>,
    /// Horizontal distance from the flying autopilot's estimate to the target at first contact, at most (m); not judged when an outside flight controller flew.
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub control_error_max_m: Option<f64>,
    /// Horizontal distance from the true position to the target at first contact, at most (m). Plain GNSS wanders by a metre, so this is for `gnss = "rtk"`.
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub position_error_max_m: Option<f64>,
    /// Share of the fuel that must be left, at least.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub fuel_left_min_fraction: Option<f64>,
    /// Share of the nitrous oxide that must be left as liquid, of that and what left the tank, at least; vapour on board counts as neither.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub nitrous_left_min_fraction: Option<f64>,
    /// Time from lift-off to first contact, at most (s).
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub flight_time_max_s: Option<f64>,
    /// Height that the pivot must have reached above its rest height, at least (m).
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub max_altitude_min_m: Option<f64>,
    /// Mass that left the vehicle plus mass on board against the start, relative, at most.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub mass_closure_max: Option<f64>,
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// On its legs, at rest, engine off.
    Landed,
    /// Fell over on the ground.
    Tipped,
    /// Hit the ground harder than the legs can take, or with something else than the legs.
    Crashed,
    /// Ended early, on request or by an abort: on its legs, at rest, engine off after an abort in flight, or back there without ever having lifted off.
    Aborted,
    /// An open-loop run reached its duration.
    Completed,
    /// Throttle without a flame.
    NoIgnition,
    /// Time ran out.
    Timeout,
}

/// A flight, ready to be flown.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// Name for reports: the file's name without folder and ending.
    pub name: String,
    /// The file's values.
    pub file: ScenarioFile,
    /// The vehicle, with the scenario's overrides of model and sensors applied.
    pub vehicle: Vehicle,
    /// The site in force.
    pub site: Site,
    /// Open-loop commands, if any.
    pub schedule: Option<Schedule>,
}

impl ScenarioFile {
    /// Applies `vehicle_set` to the vehicle's document; messages name the lines of `scenario`, where they stand.
    ///
    /// # Errors
    /// When a key cannot be set; whether it is known is judged when the vehicle is read.
    fn set_vehicle(&self, scenario: &Document, vehicle: &mut Document) -> Result<(), InputError> {
        for (key, value) in &self.vehicle_set {
            let place = scenario.place_of(&["vehicle_set", key]);
            if value.is_object() {
                let (mut dotted, mut inner) = (key.clone(), value);
                while let Some((key, value)) = inner.as_object().and_then(|table| table.iter().next()) {
                    dotted = format!("{dotted}.{key}");
                    inner = value;
                }
                let message = format!("quote the dotted key: \"{dotted}\" = {inner}");
                let diagnostic = Diagnostic { line: None, key: format!("vehicle_set.{key}"), message };
                return Err(InputError { file: place, diagnostics: vec![diagnostic] });
            }
            // Numbers, strings, booleans and lists are written alike in JSON and TOML.
            vehicle.set_from(&place, &format!("vehicle_set.\"{key}\""), key, &value.to_string())?;
        }
        Ok(())
    }

    /// Reads and checks a scenario document.
    pub fn read(document: &Document) -> Result<Self, InputError> {
        let file: Self = document.read()?;
        let mut contradictions = Vec::new();
        let norm = file.initial.q_ned_from_body.iter().map(|x| x * x).sum::<f64>().sqrt();
        if !(0.9..=1.1).contains(&norm) {
            contradictions.push(Invalid::new(
                "initial.q_ned_from_body",
                format!("norm {norm:.4} is out of range; allowed 0.9 to 1.1"),
            ));
        }
        if file.actuators.gimbal.is_some() && !file.actuators.ideal {
            contradictions.push(Invalid::new("actuators.gimbal", "only beside actuators.ideal = true"));
        }
        let step_us = file.physics.step_s * 1e6;
        if (step_us - step_us.round()).abs() > 1e-6 {
            contradictions.push(Invalid::new(
                "physics.step_s",
                format!("{} s is no whole number of microseconds", file.physics.step_s),
            ));
        }
        if file.physics.step_s != PLANT_STEP_S && file.sensors.enabled {
            contradictions.push(Invalid::new(
                "physics.step_s",
                "another step than 0.001 needs sensors.enabled = false and a command schedule",
            ));
        }
        if file.initial.engine == EngineStart::Running
            && file.initial.place == Place::Pad
            && !file.initial.clamped
        {
            contradictions
                .push(Invalid::new("initial.engine", "\"running\" needs place = \"free\" or clamped = true"));
        }
        if file.fidelity == Fidelity::Paper {
            let refused = |key: &str| {
                Invalid::new(
                    key,
                    "has no effect beside fidelity = \"paper\", which is explicit Euler at the vehicle's \
                     paper_mode.step_s",
                )
            };
            if file.physics.step_s != PLANT_STEP_S {
                contradictions.push(refused("physics.step_s"));
            }
            if file.physics.integrator != IntegratorKind::Rk4 {
                contradictions.push(refused("physics.integrator"));
            }
        }
        if let Err(invalid) = disturbance::validate(&file.disturbance) {
            contradictions.push(invalid.within("disturbance"));
        }
        if let Err(invalid) = fault::validate(&file.fault) {
            contradictions.push(invalid.within("fault"));
        }
        if contradictions.is_empty() { Ok(file) } else { Err(document.error(contradictions)) }
    }
}

impl Scenario {
    /// Joins a scenario with its vehicle and schedule.
    pub fn new(
        name: &str,
        file: ScenarioFile,
        mut vehicle: Vehicle,
        schedule: Option<Schedule>,
    ) -> Result<Self, Vec<Invalid>> {
        if let Some(model) = file.model.chamber {
            vehicle.engine_parameters.chamber.model = model;
        }
        if let Some(inertia) = file.model.gimbal_inertia {
            vehicle.gimbal.engine_inertia = inertia;
        }
        if let Some(grade) = file.sensors.gnss {
            vehicle.sensors.gnss.grade = grade;
        }
        if file.fidelity == Fidelity::Paper {
            vehicle.apply_paper_models();
        }
        if file.physics.freeze.contains(&Coupling::Slosh) {
            vehicle.slosh.model = SloshModel::Frozen;
        }
        let mut contradictions = Vec::new();
        if schedule.is_none() && file.initial.engine == EngineStart::Running {
            contradictions.push(Invalid::new("initial.engine", "\"running\" needs a command schedule"));
        }
        if schedule.is_none() && file.initial.place == Place::Free {
            contradictions.push(Invalid::new(
                "initial.place",
                "\"free\" needs a command schedule: the autopilot starts from the pad",
            ));
        }
        if !contradictions.is_empty() {
            return Err(contradictions);
        }
        let site = file.site.clone().unwrap_or_else(|| vehicle.site.clone());
        Ok(Self { name: name.to_owned(), file, vehicle, site, schedule })
    }

    /// Free flight at rest with the engine running, under one command: for tables and tests.
    pub fn free_flight(vehicle: &Vehicle, command: ActuatorCommand) -> Self {
        let initial = Initial { place: Place::Free, engine: EngineStart::Running, ..Initial::default() };
        let file = ScenarioFile {
            description: String::new(),
            vehicle: vehicle.name.clone(),
            vehicle_set: std::collections::BTreeMap::new(),
            seed: 0,
            duration_s: None,
            timeout_s: default_timeout_s(),
            arm_wait_s: 0.0,
            fc_timeout_ms: default_fc_timeout_ms(),
            on_fc_loss: OnFcLoss::default(),
            fallback_expected: false,
            commands: None,
            site: None,
            wind: WindParameters::default(),
            disturbance: Vec::new(),
            fault: Vec::new(),
            initial,
            sequence: Sequence::default(),
            actuators: Actuators::default(),
            model: Model::default(),
            fidelity: Fidelity::default(),
            physics: Physics::default(),
            sensors: Sensors { enabled: false, ..Sensors::default() },
            mission: Mission::default(),
            expect: Expect::default(),
        };
        Self {
            name: "free_flight".to_owned(),
            file,
            vehicle: vehicle.clone(),
            site: vehicle.site.clone(),
            schedule: Some(Schedule::constant(command)),
        }
    }

    /// The landing target, north and east of the pad's origin (m): the mission counts from the start.
    pub fn target_north_east_m(&self) -> [f64; 2] {
        let ([north, east], [n0, e0]) = (self.file.mission.target_north_east_m, self.start_north_east_m());
        [n0 + north, e0 + east]
    }

    /// Where the flight starts, north and east of the pad's origin (m): the origin of the autopilot's frame.
    pub(crate) fn start_north_east_m(&self) -> [f64; 2] {
        let [north, east, _] = self.file.initial.position_ned_m;
        [north, east]
    }
}
