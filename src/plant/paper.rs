//! The seed paper's scheme: explicit Euler at 0.02 s, in the centre of mass, with its own engine.
//!
//! At a knot the rate of the state is evaluated and then held until the next knot, so that the plant's clock,
//! its sensors and its loops keep their 1 ms. Position and velocity are taken to the centre of mass, stepped
//! there, and brought back with the new attitude and the new centre: the paper tracks the centre of mass and
//! does not add its drift in the body. The port grows by Eq 4, not by Euler; the attitude is normalised at
//! knots.
//!
//! Not of the paper, and therefore not on its step: servos and thruster valves move at the plant's step, what
//! is held sees them at the knots; while a pad touches the ground every step is a knot, because legs are too
//! stiff for 0.02 s. The liquid stops at the wall (`stop_fraction` of the radius, outward velocity gone)
//! where the full model has a stiff stop, which 0.02 s cannot carry.
//!
//! Source: the seed paper, Sec II.H; Eq 4 for the port; Eqs 17 to 20 for the liquid, one way; Eqs 21, 22.

use super::{Plant, Rate};
use crate::frame::Vec3;
use crate::integrator::Integrable;
use crate::propulsion::{OperatingPoint, PaperEngine};
use crate::signal::ActuatorCommand;
use crate::time::SimTime;

/// What the scheme holds between its knots.
#[derive(Clone, Debug)]
pub(super) struct Paper {
    pub(super) engine: PaperEngine,
    pub(super) step: SimTime,
    /// What the engine does until the next knot; `None` while a knot is being evaluated.
    pub(super) point: Option<OperatingPoint>,
    command: ActuatorCommand,
    rate: Option<Rate>,
    next: SimTime,
    grounded: bool,
}

impl Paper {
    pub(super) fn new(engine: PaperEngine, step: SimTime) -> Self {
        Self {
            engine,
            step,
            point: None,
            command: ActuatorCommand::SAFE,
            rate: None,
            next: SimTime::ZERO,
            grounded: false,
        }
    }
}

impl Plant {
    /// One step of the plant's clock in paper mode.
    pub(super) fn step_paper(&mut self, command: &ActuatorCommand) {
        let Some(paper) = &mut self.paper else { return };
        let touches = self.snapshot.pads_down > 0;
        let knot = paper.rate.is_none() || self.time >= paper.next || touches || paper.grounded;
        if knot {
            paper.command = *command;
            let length = if touches { self.step } else { paper.step.max(self.step) };
            paper.next = self.time + length;
            paper.grounded = touches;
            let command = paper.command;
            self.latch_commands(&command);
            let rate = self.held_rate(length.s());
            if let Some(paper) = &mut self.paper {
                paper.rate = Some(rate);
            }
        } else {
            let command = paper.command;
            self.latch_commands(&command);
        }
        let dt_s = self.step.s();
        let Some(paper) = &self.paper else { return };
        let (Some(held), Some(point)) = (paper.rate, paper.point) else { return };
        let ends = self.time + self.step >= paper.next;
        // Burnt fuel is even over the step, the radius is not.
        let port_radius_m = self.port_radius_after_burning_m(&self.state, point.fuel_kg_s * dt_s);
        let mut rate = self.with_actuators(held);
        rate.port_radius_m = (port_radius_m - self.state.port_radius_m) / dt_s;
        self.state = self.state.advanced(&rate, dt_s);
        if ends {
            self.state.q_ned_from_body.normalize_mut();
            self.contain_liquid();
        }
    }

    /// The rate at a knot, to be held for `length_s`.
    fn held_rate(&mut self, length_s: f64) -> Rate {
        if let Some(paper) = &mut self.paper {
            paper.point = None;
        }
        let now = self.evaluate(&self.state, 0.0);
        if let Some(paper) = &mut self.paper {
            paper.point = Some(now.engine);
        }
        let mut rate = now.rate;
        if self.options.clamped {
            return rate;
        }
        // Where the knot ends, but for the pivot.
        let mut end = self.state.advanced(&rate, length_s);
        end.port_radius_m = self.port_radius_after_burning_m(&self.state, now.engine.fuel_kg_s * length_s);
        end.q_ned_from_body.normalize_mut();
        let com_m = now.mass.centre_of_mass_body_m();
        let com_end_m = self.evaluate(&end, 1.0).mass.centre_of_mass_body_m();

        let (attitude, attitude_end) = (self.state.attitude(), end.attitude());
        let (spin, spin_end) = (self.state.rate_body_rad_s, end.rate_body_rad_s);
        let gravity = self.environment.gravity.acceleration_ned_m_s2();
        let velocity = self.state.velocity_ned_m_s + attitude * spin.cross(&com_m);
        let acceleration = attitude * now.acceleration.specific_force_at(com_m, spin) + gravity;
        let place_end = self.state.position_ned_m + attitude * com_m + velocity * length_s;
        let velocity_end = velocity + acceleration * length_s;
        let pivot_end = place_end - attitude_end * com_end_m;
        let pivot_velocity_end = velocity_end - attitude_end * spin_end.cross(&com_end_m);
        rate.position_ned_m = (pivot_end - self.state.position_ned_m) / length_s;
        rate.velocity_ned_m_s = (pivot_velocity_end - self.state.velocity_ned_m_s) / length_s;
        rate
    }

    /// Keeps the liquid in the tank: at the wall it stops.
    fn contain_liquid(&mut self) {
        let wall_m = self.vehicle.slosh.stop_fraction * self.vehicle.tank.radius_m;
        let place = self.state.slosh_m;
        let distance_m = place.norm();
        if distance_m > wall_m {
            let outward = place / distance_m;
            self.state.slosh_m = outward * wall_m * (1.0 - 1e-12);
            let leaving_m_s = self.state.slosh_m_s.dot(&outward).max(0.0);
            self.state.slosh_m_s -= outward * leaving_m_s;
        }
    }

    /// The held rate with what the actuators do at this step.
    fn with_actuators(&self, held: Rate) -> Rate {
        let (_, valve) = self.valve(&self.state);
        let (_, gimbal) = self.gimbal(&self.state);
        let lateral = |v: nalgebra::Vector2<f64>| Vec3::new(v.x, v.y, 0.0);
        Rate {
            valve_rad: valve.rate_rad_s,
            valve_rad_s: valve.acceleration_rad_s2,
            gimbal_rad: lateral(gimbal.rate_rad_s),
            gimbal_rad_s: lateral(gimbal.acceleration_rad_s2),
            rcs_level: self.rcs_level_rate(&self.state),
            ..held
        }
    }
}
