//! Carrying out what was asked of the bench: requests, and parameters that are set and read.
//!
//! Whatever changes a run in its course is an event, and marks the run as modified.
//!
//! | parameter | means |
//! |---|---|
//! | SIM_PAUSE; SIM_STEP n | simulated time stands; while it does, n steps of the plant |
//! | SIM_SPEED x | simulated seconds to a second |
//! | SIM_RESET 1; SIM_SEED | a new flight; its seed |
//! | F_* | a fault, or its end |
//! | WIND_*, THRUST_BIAS, MISALIGN_*, FORCE_* | wind and disturbance on top of the scenario's |

use hopbench::fault::{Fault, Row};

use crate::bench::parameter::{Parameter, What};
use crate::bench::run::Run;
use crate::wire::request::{Answer, Request, denied, unsupported};

/// The one place where a request has its effect.
pub(super) fn carry_out(run: &mut Run, request: Request) -> Answer {
    match request {
        Request::Reset => return set_up_flight(run),
        Request::Pause if !run.timeline.is_paused() => {
            run.timeline.pause();
            modified(run, "paused");
        }
        Request::Resume if run.timeline.is_paused() => {
            run.timeline.resume();
            modified(run, "resumed");
        }
        Request::Pause | Request::Resume => {}
        Request::GiveBack => run.give_back().or_else(denied)?,
        Request::Break(_) | Request::Mend(..) if run.is_over() => {
            return denied("the flight has ended: reset first");
        }
        Request::Break(faults) => {
            for fault in &faults {
                fault.validate().or_else(|invalid| denied(invalid.to_string()))?;
            }
            for fault in &faults {
                run.flight.inject(fault).or_else(|invalid| denied(invalid.to_string()))?;
            }
        }
        Request::Mend(components, mode) => {
            for component in components {
                run.flight.clear_fault(component, mode);
            }
        }
        // Whoever sends the message knows whether its rate is free.
        Request::Interval { message, .. } => return rate_not_in_hand(message),
    }
    Ok(())
}

/// The rate of a message is a sensor's, or nobody's.
pub(super) fn rate_not_in_hand(message: u32) -> Answer {
    unsupported(format!("the rate of message {message} is not in the bench's hand"))
}

/// Sets up a new flight, which begins before the next step.
fn set_up_flight(run: &mut Run) -> Answer {
    if run.controller.is_armed() && !run.options.profile.resets_armed {
        return denied("no reset while the flight controller is armed");
    }
    let seed = run.timeline.next_seed().unwrap_or_else(|| run.flight.seed());
    let next = run.flight.again(seed).or_else(|invalid| denied(format!("no new flight: {invalid}")))?;
    run.timeline.set_next_flight(next);
    Ok(())
}

/// Sets a parameter.
pub(super) fn set_parameter(run: &mut Run, parameter: &Parameter, value: f64) -> Answer {
    let Parameter { name, what, least, greatest, unit } = parameter;
    if !parameter.allows(value) {
        return denied(format!("{name} {value}: allowed {least} to {greatest} ({unit})"));
    }
    if is_in_force(run, what, value) {
        return Ok(());
    }
    match *what {
        What::Speed if run.options.fast => denied("--fast has no pace to change"),
        What::Speed => {
            run.clock.set_speed(value, run.flight.time().us());
            modified(run, &format!("{name} {value}"));
            Ok(())
        }
        What::Pause if value == 0.0 => carry_out(run, Request::Resume),
        What::Pause => carry_out(run, Request::Pause),
        What::Step if !run.timeline.is_paused() => denied("steps are made while paused"),
        What::Step => {
            run.timeline.set_steps(value as u64);
            Ok(())
        }
        What::Reset if value == 0.0 => Ok(()),
        What::Reset => carry_out(run, Request::Reset),
        What::Seed => {
            run.timeline.set_next_seed(value as u32);
            Ok(())
        }
        What::Fault(row) if value == 0.0 => {
            carry_out(run, Request::Mend(vec![row.component], Some(row.mode)))
        }
        What::Fault(row) => {
            let value = row.value.map(|_| value);
            carry_out(run, Request::Break(vec![Fault { value, ..Fault::new(row.component, row.mode) }]))
        }
        What::WindNorth | What::WindEast | What::ThrustBias | What::Misalignment(_) | What::Force(_) => {
            let mut now = *run.flight.bench_disturbance();
            match *what {
                What::WindNorth => now.wind_ned_m_s.x = value,
                What::WindEast => now.wind_ned_m_s.y = value,
                What::Misalignment(axis) => now.disturbance.misalignment_rad[axis] = value,
                What::Force(axis) => now.disturbance.force_body_n[axis] = value,
                _ => now.disturbance.thrust_bias = value,
            }
            run.flight.set_bench_disturbance(now);
            modified(run, &format!("{name} {value}"));
            Ok(())
        }
    }
}

/// Whether a parameter has this value already: then setting it changes nothing, and marks nothing.
fn is_in_force(run: &Run, what: &What, value: f64) -> bool {
    match what {
        What::Step | What::Reset => false,
        // 0 is said both of one that does not act and of one that acts with 0; an ended flight answers for
        // itself.
        What::Fault(_) if value == 0.0 || run.is_over() => false,
        _ => value == value_in_force(run, what),
    }
}

/// Value in force of what a parameter sets.
pub(super) fn value_in_force(run: &Run, what: &What) -> f64 {
    let bench_disturbance = run.flight.bench_disturbance();
    match what {
        What::Speed => run.clock.speed(),
        What::Pause => f64::from(u8::from(run.timeline.is_paused())),
        What::Step => run.timeline.steps() as f64,
        What::Reset => f64::from(u8::from(run.timeline.has_next_flight())),
        What::Seed => f64::from(run.timeline.next_seed().unwrap_or_else(|| run.flight.seed())),
        What::WindNorth => bench_disturbance.wind_ned_m_s.x,
        What::WindEast => bench_disturbance.wind_ned_m_s.y,
        What::ThrustBias => bench_disturbance.disturbance.thrust_bias,
        What::Misalignment(axis) => bench_disturbance.disturbance.misalignment_rad[*axis],
        What::Force(axis) => bench_disturbance.disturbance.force_body_n[*axis],
        What::Fault(Row { component, mode, value, .. }) => run
            .flight
            .faults()
            .filter(|fault| fault.component == *component && fault.mode == *mode)
            .last()
            .map_or(0.0, |fault| if value.is_some() { fault.value } else { 1.0 }),
    }
}

fn modified(run: &mut Run, what: &str) {
    run.flight.note_modified(what);
    run.live.notice(format!("{:.3} s: {what}", run.flight.time().s()));
}
