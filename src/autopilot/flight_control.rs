//! From the phase to the command: entering phases, tracking their references, allocation.

use super::Autopilot;
use super::abort::AbortKind;
use super::allocation::thrust_line_torque_n_m;
use super::control::{ControlInput, Controller, Demand, Limits};
use super::guidance::MissionProfile;
use super::mission::{ControlLaw, GuidanceLaw};
use super::phase::Phase;
use super::tracking::TrackerInput;
use super::trajectory::Reference;
use crate::frame::{Vec3, heading_rad};
use crate::signal::{ActuatorCommand, Discrete, Throttle};

/// Rise of the thrust from idle to lift-off (N/s): slow for the valve, short against the flight.
const LIFT_OFF_RAMP_N_S: f64 = 800.0;
/// Height above rest that only free flight reaches: legs rebound a centimetre (m).
const AIRBORNE_HEIGHT_M: f64 = 0.04;

impl Autopilot {
    /// Enters the phase of an abort when one is decided.
    pub(super) fn watch_for_abort(&mut self, dt_s: f64) {
        let (limits, phase) = (&self.parameters.mission.abort, self.sequence.phase());
        let abort_inputs = self.abort_inputs();
        match self.abort_watch.step(limits, phase, &abort_inputs, self.time, dt_s).map(|abort| abort.kind) {
            Some(AbortKind::Land) => self.sequence.enter(Phase::AbortLand, 0.0),
            Some(AbortKind::Cut) => self.sequence.enter(Phase::AbortCut, 0.0),
            None => {}
        }
    }

    /// The present motion of the pivot as a reference, its acceleration within the mission's.
    pub(super) fn present_motion(&self) -> Reference {
        let pivot = self.navigation.pivot();
        let q = self.navigation.q_ned_from_body();
        let mut acceleration = q * self.navigation.specific_force_body_m_s2();
        acceleration.z += self.parameters.navigation.gravity_m_s2;
        let mission = &self.parameters.mission;
        let most = Vec3::new(
            mission.lateral_acceleration_m_s2,
            mission.lateral_acceleration_m_s2,
            mission.acceleration_m_s2,
        );
        Reference {
            position_ned_m: pivot.position_ned_m,
            velocity_ned_m_s: pivot.velocity_ned_m_s,
            acceleration_ned_m_s2: acceleration.zip_map(&most, |a, most| a.clamp(-most, most)),
            heading_rad: heading_rad(&q),
        }
    }

    /// The profile of the mission.
    pub(super) fn mission_profile(&self) -> MissionProfile<'_> {
        MissionProfile {
            mission: &self.parameters.mission,
            rest_ned_m: self.parameters.navigation.rest_ned_m,
        }
    }

    /// Follows the closed-form ramps of a phase from the motion `from`.
    pub(super) fn follow_ramps(&mut self, phase: Phase, from: &Reference) {
        let ramps = self.mission_profile().ramps(phase, from, self.time);
        self.guidance.follow(ramps, 0.0);
    }

    /// Lands below the point where the vehicle can stop.
    fn land_at_stopping_point(&mut self) {
        let rest = self.parameters.navigation.rest_ned_m;
        let present = self.present_motion();
        let v = present.velocity_ned_m_s;
        let stop_s = libm::hypot(v.x, v.y) / (2.0 * self.parameters.mission.lateral_acceleration_m_s2);
        let target = present.position_ned_m - rest + v * stop_s;
        self.parameters.mission.target_north_east_m = [target.x, target.y];
        self.follow_ramps(Phase::AbortLand, &present);
    }

    /// Sets up reference and control at the beginning of a phase.
    pub(super) fn enter(&mut self, phase: Phase) {
        match phase {
            Phase::AbortLand => {
                self.planning.reset();
                self.land_at_stopping_point();
            }
            Phase::Ascent => {
                let heading_rad = heading_rad(&self.navigation.q_ned_from_body());
                let position_ned_m = self.parameters.navigation.rest_ned_m;
                self.controller = Controller::default();
                self.allocation = self.allocation.resume(0.0, 0.0);
                let at_rest = Reference { position_ned_m, heading_rad, ..Reference::default() };
                match self.planned_climb() {
                    Some(climb) => self.guidance.follow(climb, 0.0),
                    None => self.follow_ramps(phase, &at_rest),
                }
            }
            Phase::Hover => self.follow_ramps(phase, &self.guidance.reference()),
            // A planned landing is adopted when it comes; until then the hover goes on.
            Phase::Descent if self.parameters.mission.guidance == GuidanceLaw::Ramps => {
                self.follow_ramps(phase, &self.guidance.reference());
            }
            _ => {}
        }
    }

    /// The command of the present phase.
    pub(super) fn fly(&mut self, dt_s: f64) -> ActuatorCommand {
        let armed = ActuatorCommand {
            armed: true,
            throttle: self.throttle(0.0),
            discrete: Discrete {
                igniter: false,
                isolation_open: true,
                vent_shut: true,
                hold_down_released: false,
            },
            ..ActuatorCommand::SAFE
        };
        let idle_n = self.parameters.actuators.thrust_min_n;
        match self.sequence.phase() {
            // Disarmed, the isolation valve shuts too: a throttle valve that sticks open must not feed an
            // engine that was cut.
            Phase::Align | Phase::Done | Phase::AbortCut => ActuatorCommand::SAFE,
            Phase::Ready => armed,
            Phase::Ignition => {
                ActuatorCommand { throttle: self.throttle(idle_n), discrete: Discrete::FLIGHT, ..armed }
            }
            Phase::Ascent | Phase::Hover | Phase::Descent | Phase::Terminal | Phase::AbortLand => {
                self.track(dt_s)
            }
            Phase::Touchdown | Phase::Shutdown => {
                ActuatorCommand { discrete: Discrete { igniter: false, ..Discrete::FLIGHT }, ..armed }
            }
        }
    }

    /// Reference, tracking control, allocation.
    fn track(&mut self, dt_s: f64) -> ActuatorCommand {
        let phase = self.sequence.phase();
        let weight_n = self.propellant.mass_kg * self.parameters.navigation.gravity_m_s2;
        let actuators = &self.parameters.actuators;
        // The climb begins once the ramp carries the weight; until then the reference stands on the pad.
        let ceiling_n = if self.airborne {
            actuators.thrust_max_n
        } else {
            actuators.thrust_min_n + LIFT_OFF_RAMP_N_S * self.sequence.time_in_phase_s()
        };
        if ceiling_n >= weight_n {
            self.guidance.advance(self.navigation.pivot().position_ned_m, dt_s);
        }
        self.airborne |= phase != Phase::Ascent || self.height_m() > AIRBORNE_HEIGHT_M;

        let predicted = match self.parameters.mission.control {
            ControlLaw::Predictive if self.airborne => self.predictive(dt_s),
            _ => None,
        };
        let demand = predicted.unwrap_or_else(|| self.cascaded(ceiling_n, dt_s));
        let mass = self.mass_properties();
        let actuators = &self.parameters.actuators;
        let allocated = self.allocation.step(
            actuators,
            demand.torque_body_n_m,
            self.propellant.thrust_n(),
            mass.com_body_m,
            dt_s,
        );
        self.gimbal_saturated = allocated.saturated;
        let thrust_n =
            (demand.thrust_n / self.propellant.trim).clamp(actuators.thrust_min_n, actuators.thrust_max_n);
        let finite = |x: f64| if x.is_finite() { x } else { 0.0 };
        ActuatorCommand {
            armed: true,
            throttle: self.throttle(if thrust_n.is_finite() { thrust_n } else { weight_n }),
            gimbal_x_rad: finite(allocated.gimbal_x_rad),
            gimbal_y_rad: finite(allocated.gimbal_y_rad),
            rcs_roll: finite(allocated.rcs_roll),
            discrete: Discrete::FLIGHT,
        }
    }

    /// Demand of predictive tracking, its gimbal angles as torque; `None` on the last rung of its ladder.
    fn predictive(&mut self, dt_s: f64) -> Option<Demand> {
        let (airframe, motion, mass) = (self.airframe(), self.motion(), self.mass_properties());
        let actuators = &self.parameters.actuators;
        let trim = self.propellant.trim;
        let input = TrackerInput {
            motion: &motion,
            observer: &self.observer,
            airframe: &airframe,
            com_z_m: mass.com_body_m.z,
            gravity_m_s2: self.parameters.navigation.gravity_m_s2,
            thrust_min_n: actuators.thrust_min_n * trim,
            thrust_max_n: actuators.thrust_max_n * trim,
            previous: self.control_in_force(),
        };
        let control =
            self.tracker.step(&self.parameters.tracking, &input, |s| self.guidance.ahead(s), dt_s)?;
        // The cascaded controller is ready to take over with the disturbances of the observer.
        self.controller = self.cascade_from_observer();
        let moment = -motion.thrust_n * mass.com_body_m.z;
        let [x, y] = control.gimbal_rad.map(|angle| moment * libm::sin(angle));
        Some(Demand {
            thrust_n: control.thrust_n,
            torque_body_n_m: thrust_line_torque_n_m(motion.thrust_n, mass.com_body_m)
                + Vec3::new(x, y, control.roll_torque_n_m),
        })
    }

    /// The cascaded controller, its integrators set from the disturbance observer.
    pub(super) fn cascade_from_observer(&self) -> Controller {
        let thrust_n = self.propellant.thrust_n();
        // Wind, and the side force of an engine whose thrust line is trimmed onto the centre of mass.
        let [trim_x, trim_y] = self.observer.trim_rad(&self.airframe());
        let side = self.navigation.q_ned_from_body() * Vec3::new(trim_y, -trim_x, 0.0);
        let force = self.observer.force_ned_m_s2 + side * (thrust_n / self.propellant.mass_kg.max(1.0));
        // Allocation compensates the thrust line of the data sheet; the observer estimates all of its offset.
        let known = thrust_line_torque_n_m(thrust_n, self.mass_properties().com_body_m);
        let [x, y] = self.observer.thrust_offset_m.map(|offset| -offset * thrust_n);
        Controller::resume([x + known.x, y + known.y], [-force.x, -force.y])
    }

    /// Demand of the cascaded controller.
    fn cascaded(&mut self, ceiling_n: f64, dt_s: f64) -> Demand {
        let (motion, mass) = (self.motion(), self.mass_properties());
        let actuators = &self.parameters.actuators;
        let limits = Limits {
            tilt_rad: self.parameters.mission.tilt_limit_rad,
            thrust_min_n: actuators.thrust_min_n,
            thrust_max_n: actuators.thrust_max_n,
            gravity_m_s2: self.parameters.navigation.gravity_m_s2,
        };
        let input = ControlInput {
            limits,
            reference: self.guidance.reference(),
            motion: &motion,
            mass: &mass,
            airborne: self.airborne,
            gimbal_saturated: self.gimbal_saturated,
        };
        let demand = self.controller.step(&self.parameters.gains, &input, dt_s);
        Demand { thrust_n: demand.thrust_n.min(ceiling_n), ..demand }
    }

    /// Without an estimate of the motion: thrust equal to the weight, gimbal and roll at zero.
    pub(super) fn open_loop_command(&self) -> ActuatorCommand {
        let weight_n = self.propellant.mass_kg * self.parameters.navigation.gravity_m_s2;
        let band = &self.parameters.actuators;
        let thrust_n = (weight_n / self.propellant.trim).clamp(band.thrust_min_n, band.thrust_max_n);
        ActuatorCommand {
            throttle: self.throttle(thrust_n),
            gimbal_x_rad: 0.0,
            gimbal_y_rad: 0.0,
            rcs_roll: 0.0,
            ..self.command
        }
    }

    fn throttle(&self, thrust_n: f64) -> Throttle {
        self.parameters.actuators.throttle(
            &self.parameters.thrust_map,
            thrust_n,
            self.propellant.port_radius_m,
        )
    }
}
