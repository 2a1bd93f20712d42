//! Roll thrusters: the command for a roll torque, as a duty or as pulses.
//!
//! Two kinds of driver. One modulates pulses itself and takes the duty; pulses from here would be modulated
//! twice. The other opens a valve for as long as the command lasts; its pulses are modulated here, by an
//! integrator of the impulse error: a pulse begins when half a shortest pulse is missing and ends when as
//! much has been given in excess, so that the impulse is never wrong by a whole pulse. One signed command
//! drives both pairs, so that they never fire against each other.

/// Where pulses are modulated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RollDrive {
    /// In the driver of the valves: the command is a duty, -1..1.
    Duty,
    /// In this flight computer: the command is -1, 0 or 1.
    Pulses {
        /// Shortest time that a valve may be open (s).
        minimum_on_s: f64,
    },
}

/// Roll thrusters as the flight computer knows them.
#[derive(Clone, Debug, PartialEq)]
pub struct RollThrusters {
    /// Moment of one pair (N m).
    pub torque_n_m: f64,
    /// Nitrogen of one pair at full thrust (kg/s).
    pub flow_kg_s: f64,
    /// Share of full torque below which they stop.
    pub dead_band: f64,
    /// Where pulses are modulated.
    pub drive: RollDrive,
}

/// Hysteresis: they start at this multiple of the dead band.
const START_OVER_STOP: f64 = 1.5;

/// State of the pulse modulator, and the nitrogen count.
#[derive(Clone, Copy, Debug, Default)]
pub struct RollModulator {
    /// The demand is beyond the dead band.
    active: bool,
    /// Impulse demanded and not given, as time at full torque (s), signed.
    impulse_error_s: f64,
    /// Pulse in progress: its sign, or 0.
    pulse: f64,
    pulse_s: f64,
    /// Time at full torque so far (s).
    on_time_s: f64,
}

impl RollModulator {
    /// Command (-1..1) for the next `dt_s` from a torque about z (N m).
    pub fn step(&mut self, thrusters: &RollThrusters, torque_n_m: f64, dt_s: f64) -> f64 {
        let share = torque_n_m / thrusters.torque_n_m.max(1e-6);
        let share = if share.is_finite() { share.clamp(-1.0, 1.0) } else { 0.0 };
        let threshold = if self.active { 1.0 } else { START_OVER_STOP } * thrusters.dead_band;
        self.active = share.abs() > threshold.min(0.999);
        let duty = if self.active { share } else { 0.0 };
        match thrusters.drive {
            RollDrive::Duty => duty,
            RollDrive::Pulses { minimum_on_s } => self.pulse(duty, minimum_on_s, dt_s),
        }
    }

    /// One step of the modulator: the impulse error grows by the duty and falls by the pulse.
    fn pulse(&mut self, duty: f64, minimum_on_s: f64, dt_s: f64) -> f64 {
        // In whole steps, and never shorter than the valve can do.
        let shortest_s = (minimum_on_s / dt_s - 1e-6).ceil().max(1.0) * dt_s;
        self.impulse_error_s += duty * dt_s;
        let before = self.pulse;
        if before != 0.0 {
            let over = self.pulse_s + 1e-6 * dt_s >= shortest_s;
            let settled = self.impulse_error_s * before <= 0.5 * (dt_s - shortest_s);
            if over && (settled || duty == 0.0) {
                self.pulse = 0.0;
            }
        }
        let wanted = duty.signum();
        // An excess is not taken back by the other pair, and that one waits a step for this pulse to end.
        if self.pulse == 0.0
            && duty != 0.0
            && before != -wanted
            && self.impulse_error_s * wanted >= 0.5 * shortest_s
        {
            self.pulse = wanted;
            self.pulse_s = 0.0;
        }
        self.impulse_error_s -= self.pulse * dt_s;
        self.pulse_s += dt_s;
        self.pulse
    }

    /// Counts the nitrogen of a command in force for `dt_s`.
    pub(crate) fn count_nitrogen(&mut self, thrusters: &RollThrusters, command: f64, dt_s: f64) {
        let share = command.abs();
        if share > thrusters.dead_band {
            self.on_time_s += match thrusters.drive {
                RollDrive::Duty => share.min(1.0),
                RollDrive::Pulses { .. } => 1.0,
            } * dt_s;
        }
    }

    /// Nitrogen used so far (kg).
    pub fn nitrogen_kg(&self, thrusters: &RollThrusters) -> f64 {
        self.on_time_s * thrusters.flow_kg_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT_S: f64 = 0.004;

    fn thrusters(drive: RollDrive) -> RollThrusters {
        RollThrusters { torque_n_m: 2.0, flow_kg_s: 0.0157, dead_band: 0.05, drive }
    }

    #[test]
    fn a_driver_that_modulates_gets_the_duty() {
        let (thrusters, mut roll) = (thrusters(RollDrive::Duty), RollModulator::default());
        // Active over 1.5 dead bands, inactive under one, of full torque 2 N m.
        let commands = [0.14, 0.16, 0.12, 0.11, 0.09, 0.11, -3.0, f64::NAN];
        let shares = commands.map(|torque| roll.step(&thrusters, torque, DT_S));
        assert_eq!(shares, [0.0, 0.08, 0.06, 0.055, 0.0, 0.0, -1.0, 0.0]);
    }

    #[test]
    fn nitrogen_follows_the_duty() {
        let (thrusters, mut roll) = (thrusters(RollDrive::Duty), RollModulator::default());
        for _ in 0..250 {
            roll.count_nitrogen(&thrusters, -0.5, DT_S);
            roll.count_nitrogen(&thrusters, 0.04, DT_S);
        }
        // Half of a second of 15.7 g/s; under the dead band the driver does nothing.
        assert!((roll.nitrogen_kg(&thrusters) - 0.5 * 0.0157).abs() < 1e-12);
    }

    #[test]
    fn the_impulse_of_pulses_is_never_wrong_by_a_whole_pulse() {
        for minimum_on_s in [0.0, 0.010, 0.015, 0.020, 0.050] {
            let thrusters = thrusters(RollDrive::Pulses { minimum_on_s });
            let shortest_s = f64::max((minimum_on_s / DT_S).ceil(), 1.0) * DT_S;
            let mut roll = RollModulator::default();
            let (mut wanted_s, mut given_s, mut on_s, mut last) = (0.0, 0.0, 0.0f64, 0.0);
            let mut pulses = 0;
            for step in 0..20_000 {
                // Slow and fast, both signs, through the dead band and into saturation's edge.
                let t = f64::from(step) * DT_S;
                let share = 0.6 * libm::sin(0.7 * t) + 0.4 * libm::sin(3.1 * t);
                let command = roll.step(&thrusters, 2.0 * share, DT_S);
                assert!([-1.0, 0.0, 1.0].contains(&command));
                wanted_s += if roll.active { share * DT_S } else { 0.0 };
                given_s += command * DT_S;
                let error_s: f64 = wanted_s - given_s;
                assert!(error_s.abs() < shortest_s, "{error_s} s at {t} s for {minimum_on_s} s");
                assert!(command * last >= 0.0, "one pair right after the other at {t} s");
                if command == last {
                    on_s += DT_S;
                } else {
                    assert!(last == 0.0 || on_s > shortest_s - 1e-9, "{on_s} s at {t} s");
                    pulses += i32::from(last != 0.0);
                    on_s = DT_S;
                }
                last = command;
            }
            assert!(pulses > 50, "{pulses}");
        }
    }
}
