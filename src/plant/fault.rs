//! What is broken in the vehicle: how a [`PlantEffect`] reaches servos, valves, thrusters, regulator, flame
//! and engine.
//!
//! Everything here changes between steps. The engine controller goes on with the sound engine
//! ([`super::command`]): a valve that is off or a chamber that burns badly is seen as thrust that is not what
//! was asked for. It reads the tank's pressure as it does in blow-down, so it opens the valve farther under a
//! regulator that droops, until that is open. Ideal actuators have no dynamics to slow and no play to widen;
//! the rest acts on them at once.
//!
//! A regulator that droops lets no gas back: the tank falls as its gas expands into the room that the liquid
//! leaves, at constant temperature, down to the lower outlet pressure; it recovers with the regulator's
//! response time. With gas as a state the regulator's own balance does that.

use super::{Evaluation, Plant, State};
use crate::actuator::{Servo, StrokeValve};
use crate::fault::PlantEffect;
use crate::fault::plant::{ServoEffect, ThrusterEffect};
use crate::propulsion::{Damage, PairLevels, PressureSpike, Stores};
use crate::vehicle::GasModel;

/// Faults that act, as the rate of the state feels them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FaultState {
    pub(super) damage: Damage,
    /// Share of the full-open area that passes the shut oxidiser valve.
    valve_leak_share: f64,
    /// The servos as they are now.
    pub(super) valve_servo: Servo,
    pub(super) gimbal_servo: [Servo; 2],
    /// Outlet of the regulator below its set pressure (Pa).
    pub(super) sag_pa: f64,
    pub(super) pressure_spike: PressureSpike,
}

/// Faults that act, as everything else feels them, and what they leave behind from step to step.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct FaultMemory {
    pub(super) effect: PlantEffect,
    /// Gas above the liquid that a regulator has let in (kg).
    trapped_nitrogen_kg: f64,
    /// Oxidiser that waits in the cold chamber for a flame (kg).
    pool_kg: f64,
}

impl FaultState {
    /// A vehicle without faults.
    pub(super) fn none(valve_servo: Servo, gimbal_servo: Servo) -> Self {
        Self {
            damage: Damage::NONE,
            valve_leak_share: 0.0,
            valve_servo,
            gimbal_servo: [gimbal_servo; 2],
            sag_pa: 0.0,
            pressure_spike: PressureSpike::NONE,
        }
    }
}

impl FaultMemory {
    /// Valve angle that its servo is told (rad).
    pub(super) fn valve_target_rad(&self, command_rad: f64, servo: &Servo) -> f64 {
        servo_target_rad(&self.effect.valve, command_rad, servo.upper_rad)
    }

    /// Gimbal angles that their servos are told (rad).
    pub(super) fn gimbal_target_rad(&self, command_rad: [f64; 2], servos: &[Servo; 2]) -> [f64; 2] {
        std::array::from_fn(|axis| {
            servo_target_rad(&self.effect.gimbal[axis], command_rad[axis], servos[axis].upper_rad)
        })
    }

    /// Opening of the isolation valve a step (s) later.
    pub(super) fn isolation_after(&self, nominal: StrokeValve, opening: f64, open: bool, step_s: f64) -> f64 {
        let isolation = &self.effect.isolation;
        if isolation.stuck {
            return opening;
        }
        let stroke = StrokeValve { stroke_time_s: nominal.stroke_time_s * isolation.slowness };
        stroke.opening_after(opening, if open { 1.0 } else { 0.0 }, step_s)
    }

    /// Duty of the thruster pairs, dead and leaking valves taken into account.
    pub(super) fn pairs_open(&self, opened: PairLevels) -> PairLevels {
        let [positive, negative] = &self.effect.rcs;
        let passes = |opened: f64, thruster: &ThrusterEffect| {
            let opened = if thruster.dead { 0.0 } else { opened };
            opened.max(thruster.leak_share)
        };
        PairLevels { a: passes(opened.a, negative), b: passes(opened.b, positive) }
    }
}

/// What a servo is told in place of its command (rad).
fn servo_target_rad(effect: &ServoEffect, command_rad: f64, limit_rad: f64) -> f64 {
    match effect.held_at_share {
        Some(share) => share * limit_rad,
        None if effect.offset_rad == 0.0 => command_rad,
        // The loop brings what it measures to the command, and the angle is off by as much as that.
        None => command_rad + effect.offset_rad,
    }
}

/// A servo with what has befallen it.
fn with_fault(sound: &Servo, effect: &ServoEffect) -> Servo {
    Servo {
        drive_share: if effect.stuck { 0.0 } else { effect.rate_share },
        backlash_rad: sound.backlash_rad + effect.slack_rad,
        ..*sound
    }
}

impl Plant {
    /// Sets the faults in force.
    pub fn set_faults(&mut self, effect: &PlantEffect) {
        if self.discrete.fault_memory.effect == *effect {
            return;
        }
        let before = self.gimbal(&self.state).0;
        self.discrete.fault_memory.effect = *effect;
        let faults = &mut self.inputs.faults;
        faults.damage = Damage {
            injector_blocked_share: effect.injector_blocked_share,
            efficiency_drop_share: effect.efficiency_drop_share,
        };
        faults.valve_leak_share = effect.valve_leak_share;
        faults.valve_servo = with_fault(&self.vehicle.valve_servo, &effect.valve);
        for (servo, effect) in faults.gimbal_servo.iter_mut().zip(&effect.gimbal) {
            *servo = with_fault(&self.vehicle.gimbal_servo, effect);
        }
        // Play that comes or goes lets the engine loose or takes it along.
        self.apply_play_impulse(before);
    }

    /// Open area of the oxidiser valve, with what leaks past its ball (m²).
    #[inline]
    pub(super) fn valve_area_m2(&self, valve_rad: f64) -> f64 {
        let valve = self.vehicle.engine.valve_area();
        let area_m2 = valve.area_m2(valve_rad);
        let leak_share = self.inputs.faults.valve_leak_share;
        if leak_share <= 0.0 {
            return area_m2;
        }
        // A second way beside the ball, that is no more when the ball is out of the way.
        let (_, open_m2) = valve.fully_open();
        area_m2 + leak_share.min(1.0) * (open_m2 - area_m2).max(0.0)
    }

    /// Bottle, tank and regulator at a state.
    #[inline]
    pub(super) fn stores(&self, state: &State) -> Stores {
        Stores {
            nitrogen_kg: state.nitrogen_kg,
            nitrous_kg: state.nitrous_kg,
            gas: state.gas,
            regulator_sag_pa: self.inputs.faults.sag_pa,
        }
    }

    /// Whether oxidiser flows through a valve that should be shut.
    pub(super) fn leaks(&self, now: &Evaluation) -> bool {
        self.discrete.fault_memory.effect != PlantEffect::default() && now.engine.tank_kg_s > 0.0
    }

    /// Regulator, pool and surge a step later.
    pub(super) fn advance_faults(&mut self, now: &Evaluation) {
        self.advance_regulator(now);
        let step_s = self.step.s();
        let faults = &mut self.inputs.faults;
        faults.pressure_spike = faults.pressure_spike.after(step_s);
        let pooling_kg_s = self.discrete.fault_memory.effect.hard_start * now.engine.oxidizer_kg_s;
        // Without flow the pool boils off, beside a flame there is none.
        let pools = pooling_kg_s > 0.0 && !self.inputs.lit;
        let pool_kg = &mut self.discrete.fault_memory.pool_kg;
        *pool_kg = if pools { *pool_kg + pooling_kg_s * step_s } else { 0.0 };
    }

    fn advance_regulator(&mut self, now: &Evaluation) {
        let sag_pa = self.inputs.faults.sag_pa;
        let droop_pa = self.discrete.fault_memory.effect.regulator_droop_pa;
        // What a regulator that works has let in; one above its outlet lets nothing in, and the vent goes on
        // letting out.
        let trapped_nitrogen_kg = &mut self.discrete.fault_memory.trapped_nitrogen_kg;
        if droop_pa <= sag_pa || *trapped_nitrogen_kg <= 0.0 {
            *trapped_nitrogen_kg = now.pressurant.tank_kg;
        } else {
            let vented_kg_s = now.rate.expelled_vent_kg - now.rate.vented_vapor_kg;
            *trapped_nitrogen_kg =
                (*trapped_nitrogen_kg - vented_kg_s * self.step.s()).max(f64::MIN_POSITIVE);
        }
        if droop_pa == sag_pa {
            return;
        }
        let regulator = &self.vehicle.pressurant.regulator;
        self.inputs.faults.sag_pa = match self.vehicle.gas_model {
            GasModel::EnergyBalance(_) => droop_pa,
            GasModel::Isothermal if droop_pa > sag_pa => {
                let room_m3 = self.vehicle.ullage_m3(self.state.nitrous_kg);
                let trapped_nitrogen_kg_m3 =
                    self.discrete.fault_memory.trapped_nitrogen_kg / room_m3.max(f64::MIN_POSITIVE);
                let trapped_nitrogen_pa =
                    self.vehicle.pressurant_gas.ullage.pressure_pa(trapped_nitrogen_kg_m3);
                (regulator.set_pressure_pa - trapped_nitrogen_pa).clamp(sag_pa, droop_pa)
            }
            GasModel::Isothermal => {
                let left = libm::exp(-self.step.s() / regulator.response_time_s);
                let sag_pa = droop_pa + left * (sag_pa - droop_pa);
                if sag_pa - droop_pa < 1.0 { droop_pa } else { sag_pa }
            }
        };
    }

    /// The flame meets what has pooled.
    pub(super) fn ignite_pool(&mut self, now: &Evaluation) {
        let pool_kg = self.discrete.fault_memory.pool_kg;
        let condition = self.engine_condition(&self.state);
        let engine = &self.vehicle.engine;
        self.inputs.faults.pressure_spike =
            engine.hard_start(&condition, now.engine.oxidizer_kg_s, pool_kg, self.step.s());
        self.discrete.fault_memory.pool_kg = 0.0;
    }
}
