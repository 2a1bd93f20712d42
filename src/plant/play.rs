//! Play of the gimbal: what the body feels when it is taken up or left.
//!
//! Inside the play the engine stands still against the body, beyond it follows the servo; which of the two
//! holds during a step ([`crate::actuator::Servo::output`]). So angle and rate of the engine jump between
//! steps, and vehicle and liquid take the blow: their velocities jump such that momentum about the pivot
//! stays as it was.

use super::Plant;
use super::continuous::slosh_states;
use crate::dynamics::Load;
use crate::dynamics::mass::{ContentsRate, FlowTerms};
use crate::dynamics::rigid_body::{self, Balance, GimbalMotion, Swing};
use crate::frame::{Vec3, frd_from_structural};

impl Plant {
    /// Takes in where a step has left the gimbal's play and friction.
    pub(super) fn advance_gimbal_memory(&mut self) {
        let servos = self.inputs.faults.gimbal_servo;
        let play = servos.iter().any(|servo| servo.backlash_rad > 0.0);
        let before = play.then(|| self.gimbal(&self.state).0);
        for (axis, memory) in self.inputs.gimbal_memory.iter_mut().enumerate() {
            *memory = servos[axis].memory_after(self.state.gimbal_rad[axis], memory);
        }
        if let Some(before) = before {
            self.apply_play_impulse(before);
        }
    }

    /// Lets vehicle and liquid take the blow of an engine that moved so a moment ago, and now moves
    /// otherwise.
    pub(super) fn apply_play_impulse(&mut self, before: GimbalMotion) {
        if !self.vehicle.gimbal.engine_inertia || self.options.clamped {
            return;
        }
        let after = self.gimbal(&self.state).0;
        if (after.angle_rad, after.rate_rad_s) == (before.angle_rad, before.rate_rad_s) {
            return;
        }

        let (vehicle, state) = (&self.vehicle, &self.state);
        let supply = vehicle.gas_supply(&self.stores(state), self.environment.atmosphere.pressure_pa);
        let (contents, _) = self.contents(state, state.nitrous_kg, supply.nitrogen(), 0.0);
        let mut mass = vehicle.mass.evaluate(&contents, &ContentsRate::default());
        self.frozen.hold(&mut mass);
        let modes =
            vehicle.slosh.modes(vehicle.mass.tank(), state.nitrous_kg, vehicle.nitrous_density_kg_m3, 0.0);
        let slosh_states = slosh_states(state);
        let still = FlowTerms::none();
        let balance = |gimbal| Balance {
            vehicle: &mass.vehicle,
            flow: &still,
            rate_body_rad_s: state.rate_body_rad_s,
            load: Load::NONE,
            slosh: [0, 1].map(|n: usize| modes[n].as_ref().map(|mode| (mode, &slosh_states[n]))),
            swing: Some(Swing { part: &mass.swinging, gimbal }),
        };
        let attitude = state.attitude();
        let velocity_body_m_s = attitude.inverse() * state.velocity_ned_m_s;
        let jump = rigid_body::velocity_jump(&balance(before), &balance(after), velocity_body_m_s);

        let imu = frd_from_structural(vehicle.sensors.imu.position_m);
        let [first, second] = jump.slosh_body_m_s2.map(|jump_m_s| Vec3::new(jump_m_s.x, jump_m_s.y, 0.0));
        let state = &mut self.state;
        state.velocity_ned_m_s += attitude * jump.specific_force_body_m_s2;
        state.rate_body_rad_s += jump.angular_body_rad_s2;
        state.slosh_m_s += first;
        state.second_slosh_m_s += second;
        state.imu_velocity_body_m_s += jump.specific_force_at(imu, Vec3::zeros());
    }
}
