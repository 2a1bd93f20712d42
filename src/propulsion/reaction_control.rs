//! Roll thrusters: cold nitrogen, on/off valves, pulse modulated.
//!
//! A discrete part, called once per step, turns the command into the share of the step during which a
//! pair's valves are open, so that the impulse of a pulse does not depend on the step. A continuous
//! part, the rise of the thrust, is a state per pair.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::environment::atmosphere::STANDARD_GRAVITY_M_S2;
use crate::frame::{Vec3, frd_from_structural};
use crate::input::Invalid;
use crate::time::SimTime;

/// Reaction control: the `[rcs]` table.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReactionControl {
    /// Thrust of one thruster (N).
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub thrust_n: f64,
    /// Specific impulse (s).
    #[schemars(range(min = 10.0, max = 400.0))]
    pub specific_impulse_s: f64,
    /// How a command becomes pulses.
    pub drive: Drive,
    /// Period of the modulation (s).
    #[schemars(range(min = 0.005, max = 10.0))]
    pub period_s: f64,
    /// Share of full command under which both pairs are off.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub dead_band: f64,
    /// Shortest pulse (s); shorter ones are skipped and carried over.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub minimum_on_time_s: f64,
    /// Command to the first motion of the valve (s).
    #[schemars(range(min = 0.0, max = 0.1))]
    pub delay_s: f64,
    /// First-order lag of the thrust, up and down (s).
    #[schemars(range(min = 1e-3, max = 1.0))]
    pub rise_time_constant_s: f64,
    /// Bottle pressure under which the thrust falls in proportion (Pa).
    #[schemars(range(min = 1e3, max = 350e5))]
    pub supply_minimum_pa: f64,
    /// The thrusters.
    pub thruster: Vec<Thruster>,
}

/// How a command becomes pulses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Drive {
    /// Duty is the magnitude of the command, over `period_s`.
    PulseModulated,
    /// On above the dead band.
    OnOff,
}

/// One thruster: an entry of `[[rcs.thruster]]`.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Thruster {
    /// Name.
    pub name: String,
    /// Which pair it fires with.
    pub pair: Pair,
    /// Position, structural frame (m).
    #[schemars(inner(range(min = -20.0, max = 20.0)))]
    pub position_m: [f64; 3],
    /// Direction of the force on the vehicle, structural frame; normalised when used.
    #[schemars(inner(range(min = -1.0, max = 1.0)))]
    pub force_direction: [f64; 3],
}

/// Thrusters that fire together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Pair {
    /// Negative roll commands: negative moment about FRD z.
    A,
    /// Positive roll commands: positive moment about FRD z.
    B,
}

/// Thrust level of each pair, 0..1: the continuous state, and by its shape its rate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PairLevels {
    /// Pair a.
    pub a: f64,
    /// Pair b.
    pub b: f64,
}

/// Force and moment of the thrusters about the origin of the body frame, and the nitrogen they use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThrusterLoads {
    /// Force (N), body axes.
    pub force_body_n: Vec3,
    /// Moment (N m), body axes.
    pub moment_body_n_m: Vec3,
    /// Nitrogen used (kg/s).
    pub nitrogen_kg_s: f64,
}

impl ThrusterLoads {
    const NONE: Self = Self {
        force_body_n: Vec3::new(0.0, 0.0, 0.0),
        moment_body_n_m: Vec3::new(0.0, 0.0, 0.0),
        nitrogen_kg_s: 0.0,
    };
}

/// An interval in which a pair's valves are open [us since step 0].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Pulse {
    from_us: u64,
    to_us: u64,
}

/// Pulses that may still overlap a step; the oldest is overwritten first.
const PULSES: usize = 8;

/// State of the pulse modulator between steps.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Modulator {
    pulses: [[Pulse; PULSES]; 2],
    next: [usize; 2],
    period_end_us: u64,
    /// Impulse time owed to each pair by pulses that were too short (s).
    owed_s: [f64; 2],
}

impl ReactionControl {
    /// Checks the keys against each other.
    pub fn validate(&self) -> Result<(), Invalid> {
        if self.minimum_on_time_s > self.period_s {
            let message = format!("{} s exceeds period_s = {} s", self.minimum_on_time_s, self.period_s);
            return Err(Invalid::new("minimum_on_time_s", message));
        }
        // Pulses on their way must fit the modulator's memory.
        let longest_s = (PULSES - 2) as f64 * self.period_s;
        if self.delay_s > longest_s {
            let message =
                format!("{} s is out of range; allowed up to six periods, {longest_s} s", self.delay_s);
            return Err(Invalid::new("delay_s", message));
        }
        if self.thruster.len() > 16 {
            return Err(Invalid::new(
                "thruster",
                format!("{} thrusters; allowed up to 16", self.thruster.len()),
            ));
        }
        for (i, thruster) in self.thruster.iter().enumerate() {
            if Vec3::from(thruster.force_direction).norm() < 1e-6 {
                return Err(Invalid::new(format!("thruster[{i}].force_direction"), "has no length"));
            }
        }
        Ok(())
    }

    /// Discrete part: call once per step with the command that holds from `now` on. Returns the share of
    /// the step `now..now + dt` during which the valves of each pair are open.
    pub(crate) fn modulate(
        &self,
        modulator: &mut Modulator,
        command: f64,
        now: SimTime,
        dt: SimTime,
    ) -> PairLevels {
        let command = if command.is_finite() { command.clamp(-1.0, 1.0) } else { 0.0 };
        let on = command.abs() > self.dead_band;
        let pair = usize::from(command > 0.0);
        let delay_us = SimTime::from_s(self.delay_s).us();
        match self.drive {
            Drive::OnOff => {
                if on {
                    let from_us = now.us() + delay_us;
                    modulator.open(pair, Pulse { from_us, to_us: from_us + dt.us() });
                }
            }
            Drive::PulseModulated => {
                if now.us() >= modulator.period_end_us {
                    modulator.period_end_us = now.us() + SimTime::from_s(self.period_s).us();
                    self.begin_period(modulator, on, pair, command.abs(), now.us() + delay_us);
                }
            }
        }
        PairLevels { a: modulator.open_share(0, now, dt), b: modulator.open_share(1, now, dt) }
    }

    fn begin_period(&self, modulator: &mut Modulator, on: bool, pair: usize, duty: f64, from_us: u64) {
        modulator.owed_s[1 - pair] = 0.0;
        if !on {
            modulator.owed_s[pair] = 0.0;
            return;
        }
        let wanted_s = duty * self.period_s + modulator.owed_s[pair];
        if wanted_s < self.minimum_on_time_s {
            modulator.owed_s[pair] = wanted_s;
            return;
        }
        let on_s = wanted_s.min(self.period_s);
        modulator.owed_s[pair] = wanted_s - on_s;
        modulator.open(pair, Pulse { from_us, to_us: from_us + SimTime::from_s(on_s).us() });
    }

    /// Rate of the levels (1/s) toward the share of the step in which the valves are open.
    pub fn rate(&self, levels: &PairLevels, open: &PairLevels) -> PairLevels {
        let per_s = 1.0 / self.rise_time_constant_s;
        PairLevels { a: (open.a - levels.a) * per_s, b: (open.b - levels.b) * per_s }
    }

    /// Force and moment on the vehicle, and nitrogen used.
    #[inline]
    pub fn loads(&self, levels: &PairLevels, supply_pa: f64) -> ThrusterLoads {
        if levels.a <= 0.0 && levels.b <= 0.0 {
            return ThrusterLoads::NONE;
        }
        self.firing_loads(levels, supply_pa)
    }

    #[inline(never)]
    fn firing_loads(&self, levels: &PairLevels, supply_pa: f64) -> ThrusterLoads {
        let supply = (supply_pa / self.supply_minimum_pa).clamp(0.0, 1.0);
        let mut loads = ThrusterLoads::NONE;
        for thruster in &self.thruster {
            let level = match thruster.pair {
                Pair::A => levels.a,
                Pair::B => levels.b,
            };
            let thrust_n = self.thrust_n * supply * level.clamp(0.0, 1.0);
            let direction = frd_from_structural(thruster.force_direction);
            let force = direction * (thrust_n / direction.norm().max(1e-12));
            loads.force_body_n += force;
            loads.moment_body_n_m += frd_from_structural(thruster.position_m).cross(&force);
            loads.nitrogen_kg_s += thrust_n / (STANDARD_GRAVITY_M_S2 * self.specific_impulse_s);
        }
        loads
    }
}

impl Modulator {
    /// Adds a pulse; one that begins where the last ends continues it.
    fn open(&mut self, pair: usize, pulse: Pulse) {
        let last = (self.next[pair] + PULSES - 1) % PULSES;
        let previous = &mut self.pulses[pair][last];
        if previous.to_us == pulse.from_us && previous.to_us > previous.from_us {
            previous.to_us = pulse.to_us;
        } else {
            self.pulses[pair][self.next[pair]] = pulse;
            self.next[pair] = (self.next[pair] + 1) % PULSES;
        }
    }

    fn open_share(&self, pair: usize, now: SimTime, dt: SimTime) -> f64 {
        let (from_us, to_us) = (now.us(), now.us() + dt.us());
        let overlap = |p: &Pulse| p.to_us.min(to_us).saturating_sub(p.from_us.max(from_us));
        let open_us: u64 = self.pulses[pair].iter().map(overlap).sum();
        if dt.us() == 0 { 0.0 } else { (open_us as f64 / dt.us() as f64).min(1.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reference() -> ReactionControl {
        // `y`: of the force in body FRD, which is against structural y.
        let thruster = |name: &str, pair, x: f64, y: f64| Thruster {
            name: name.into(),
            pair,
            position_m: [x, 0.0, 1.28],
            force_direction: [0.0, -y, 0.0],
        };
        ReactionControl {
            thrust_n: 5.0,
            specific_impulse_s: 65.0,
            drive: Drive::PulseModulated,
            period_s: 0.1,
            dead_band: 0.05,
            minimum_on_time_s: 0.02,
            delay_s: 0.005,
            rise_time_constant_s: 0.01,
            supply_minimum_pa: 15e5,
            thruster: vec![
                thruster("a1", Pair::A, 0.2, -1.0),
                thruster("a2", Pair::A, -0.2, 1.0),
                thruster("b1", Pair::B, 0.2, 1.0),
                thruster("b2", Pair::B, -0.2, -1.0),
            ],
        }
    }

    #[test]
    fn pair_b_gives_two_newton_metres_about_frd_z_and_no_force() {
        let loads = reference().loads(&PairLevels { a: 0.0, b: 1.0 }, 100e5);
        assert!((loads.moment_body_n_m - Vec3::new(0.0, 0.0, 2.0)).norm() < 1e-12, "{loads:?}");
        assert!(loads.force_body_n.norm() < 1e-12);
        assert!((loads.nitrogen_kg_s - 10.0 / (65.0 * 9.80665)).abs() < 1e-15);
        assert!(
            (reference().loads(&PairLevels { a: 1.0, b: 0.0 }, 7.5e5).moment_body_n_m.z + 1.0).abs() < 1e-12
        );
    }

    fn mean_level(command: f64, dt_us: u64) -> (f64, f64) {
        let rcs = reference();
        let (mut modulator, mut sum) = (Modulator::default(), PairLevels::default());
        let steps = 10_000_000 / dt_us;
        for i in 0..steps {
            let now = SimTime::from_us(i * dt_us);
            let open = rcs.modulate(&mut modulator, command, now, SimTime::from_us(dt_us));
            sum.a += open.a / steps as f64;
            sum.b += open.b / steps as f64;
        }
        (sum.a, sum.b)
    }

    #[test]
    fn duty_is_the_command_even_when_single_pulses_would_be_too_short() {
        for (command, dt_us) in
            [(1.0, 1000), (0.5, 1000), (0.13, 1000), (0.07, 1000), (-0.07, 700), (0.333, 3000)]
        {
            let (a, b) = mean_level(command, dt_us);
            let (on, off) = if command > 0.0 { (b, a) } else { (a, b) };
            // One period in a hundred begun or owed, and periods stretched to whole steps.
            assert!((on - f64::abs(command)).abs() < 0.03 * f64::abs(command) + 0.003, "{command}: {on}");
            assert_eq!(off, 0.0);
        }
        assert_eq!(mean_level(0.049, 1000), (0.0, 0.0));
    }

    #[test]
    fn a_pulse_begins_after_the_delay_and_keeps_its_length() {
        let rcs = reference();
        let mut modulator = Modulator::default();
        let open: Vec<f64> = (0..100)
            .map(|i| {
                rcs.modulate(&mut modulator, 0.305, SimTime::from_us(1000 * i), SimTime::from_us(1000)).b
            })
            .collect();
        assert!(open[..5].iter().all(|share| *share == 0.0));
        assert!((open.iter().sum::<f64>() - 30.5).abs() < 1e-9);
    }
}
